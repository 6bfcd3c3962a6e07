from .bag_writer import BagTopic, BagWriter
from .case import Case, open_case
from .case_images import (
    IMAGE_DEPTH_TOPIC,
    CaseImages,
    image_depths,
    open_case_images,
    stale_after_ns,
)
from .conversion import convert_case, recover_recording
from .frame_streams import EdgeCount, RecordingInventory, agreed_sample, with_watchdog
from .frames_recorder import Recorder, write_recording
from .images.current_image import CurrentImage, ImagePose, ImageSource, PoseHistory
from .images.image_layout import standard_image
from .images.image_sequence import ImageHeader, ImageSequence, read_image_header
from .images.probe_calibration import DepthCalibration, ImageDepths, read_image_calibration
from .live_file import (
    IgtlSourceEntry,
    LiveCase,
    LiveSourceEntry,
    TfSourceEntry,
    TopicSourceEntry,
    open_live,
)
from .manifest.case_file import CaseManifest, ClockEntry, Provenance, RecordingEntry, load_manifest
from .manifest.display_items import (
    DISPLAY_ITEMS,
    ENERGY_DEVICE,
    MAX_POINTER_SIGMA_MM,
    MAX_ROD_MM,
    MIN_POINTER_MM,
    MIN_ROD_MM,
    DisplayItem,
    ItemKind,
    PointerEntry,
    RodEntry,
)
from .manifest.expected import (
    Expected,
    ExpectedBreach,
    ExpectedBreaches,
    ExpectedDropout,
    ExpectedRegistration,
    ExpectedStructure,
    load_expected,
    write_expected,
)
from .manifest.images import MAX_DEPTH_MM, ImagesEntry
from .manifest.key_rules import MarginEntry, check_topic
from .manifest.parts import (
    TUMOR_MESH_FRAME,
    ContourEntry,
    MeshEntry,
    SegmentationEntry,
    ToolEntry,
    TumorEntry,
)
from .manifest.plausibility import (
    ApproachEntry,
    BoxEntry,
    DistanceEntry,
    EnvelopeEntry,
    MotionEntry,
    PlausibilityEntry,
    SphereEntry,
)
from .manifest.robot import Dwell, RegistrationEntry, RobotEntry
from .manifest.structures import ArmEntry, StructureEntry, StructureMargins
from .messages.decoder import values_reader
from .messages.message_values import message_definition, read_image_message
from .new_case import RECORDING_FOLDER, TrackedBody, begin_case, write_case
from .new_manifest import DOCUMENTS, write_case_manifest, write_live_manifest
from .player import Playback, PlayedSamples, Player
from .readers.igsio.igsio_header import read_igsio
from .readers.mrml.mrml_recording import read_mrml
from .readers.recording_format import (
    RecordingFormat,
    SideTopics,
    has_ending,
    read_recording,
    recording_formats,
    recording_kinds,
)
from .readers.rosbag2.bag_frames import read_mcap
from .session_values import (
    RegistrationValues,
    SessionValues,
    StructureValues,
    received_values,
    sent_values,
)
from .tracking_frames import Activation, ActivationTrail, JointSample, TrackingFrame
from .tumor import (
    SEGMENTATION_ENDING,
    BuiltTumor,
    tumor_from_contour,
    tumor_from_segmentation,
)

__all__ = [
    "DISPLAY_ITEMS",
    "DOCUMENTS",
    "ENERGY_DEVICE",
    "IMAGE_DEPTH_TOPIC",
    "MAX_DEPTH_MM",
    "MAX_POINTER_SIGMA_MM",
    "MAX_ROD_MM",
    "MIN_POINTER_MM",
    "MIN_ROD_MM",
    "RECORDING_FOLDER",
    "SEGMENTATION_ENDING",
    "TUMOR_MESH_FRAME",
    "Activation",
    "ActivationTrail",
    "ApproachEntry",
    "ArmEntry",
    "BagTopic",
    "BagWriter",
    "BoxEntry",
    "BuiltTumor",
    "Case",
    "CaseImages",
    "CaseManifest",
    "ClockEntry",
    "ContourEntry",
    "CurrentImage",
    "DepthCalibration",
    "DisplayItem",
    "DistanceEntry",
    "Dwell",
    "EdgeCount",
    "EnvelopeEntry",
    "Expected",
    "ExpectedBreach",
    "ExpectedBreaches",
    "ExpectedDropout",
    "ExpectedRegistration",
    "ExpectedStructure",
    "IgtlSourceEntry",
    "ImageDepths",
    "ImageHeader",
    "ImagePose",
    "ImageSequence",
    "ImageSource",
    "ImagesEntry",
    "ItemKind",
    "JointSample",
    "LiveCase",
    "LiveSourceEntry",
    "MarginEntry",
    "MeshEntry",
    "MotionEntry",
    "PlausibilityEntry",
    "Playback",
    "PlayedSamples",
    "Player",
    "PointerEntry",
    "PoseHistory",
    "Provenance",
    "Recorder",
    "RecordingEntry",
    "RecordingFormat",
    "RecordingInventory",
    "RegistrationEntry",
    "RegistrationValues",
    "RobotEntry",
    "RodEntry",
    "SegmentationEntry",
    "SessionValues",
    "SideTopics",
    "SphereEntry",
    "StructureEntry",
    "StructureMargins",
    "StructureValues",
    "TfSourceEntry",
    "ToolEntry",
    "TopicSourceEntry",
    "TrackedBody",
    "TrackingFrame",
    "TumorEntry",
    "agreed_sample",
    "begin_case",
    "check_topic",
    "convert_case",
    "has_ending",
    "image_depths",
    "load_expected",
    "load_manifest",
    "message_definition",
    "open_case",
    "open_case_images",
    "open_live",
    "read_igsio",
    "read_image_calibration",
    "read_image_header",
    "read_image_message",
    "read_mcap",
    "read_mrml",
    "read_recording",
    "received_values",
    "recording_formats",
    "recording_kinds",
    "recover_recording",
    "sent_values",
    "stale_after_ns",
    "standard_image",
    "tumor_from_contour",
    "tumor_from_segmentation",
    "values_reader",
    "with_watchdog",
    "write_case",
    "write_case_manifest",
    "write_expected",
    "write_live_manifest",
    "write_recording",
]
