from .case import Case, MeshOwner, open_case
from .case_images import CaseImages, image_depths, open_case_images, stale_after_ns
from .convert import convert_case
from .copying import recover_recording
from .frames.assembly import agreed_sample
from .frames.cautery import CauteryState, CauteryTrail
from .frames.inventory import EdgeCount, RecordingInventory
from .frames.playback import Playback, PlayedSamples
from .frames.player import Player
from .frames.samples import JointSample, TrackingFrame
from .frames.watchdog import with_watchdog
from .images.calibration import read_image_calibration
from .images.current import CurrentImage, ImagePose, ImageSource
from .images.depths import DepthCalibration, ImageDepths
from .images.orientation import standard_image
from .images.pose_history import PoseHistory
from .images.recorded_depths import IMAGE_DEPTH_TOPIC
from .images.sequence import ImageHeader, ImageSequence, read_image_header
from .live_file import (
    IgtlSourceEntry,
    LiveCase,
    LiveSourceEntry,
    TfSourceEntry,
    TopicSourceEntry,
    open_live,
)
from .live_recording import RECORDING_FOLDER, begin_case
from .manifest.case_file import CaseManifest, ClockEntry, Provenance, RecordingEntry, load_manifest
from .manifest.expected import (
    Expected,
    ExpectedBreach,
    ExpectedBreaches,
    ExpectedDropout,
    ExpectedRegistration,
    load_expected,
    write_expected,
)
from .manifest.images import MAX_DEPTH_MM, ImagesEntry
from .manifest.key_rules import check_topic
from .manifest.margins import MarginEntry
from .manifest.parts import (
    MAX_NEEDLE_MM,
    MAX_STYLUS_SIGMA_MM,
    MIN_NEEDLE_MM,
    MIN_STYLUS_MM,
    TUMOR_MESH_FRAME,
    ContourEntry,
    MeshEntry,
    NeedleEntry,
    SegmentationEntry,
    StylusEntry,
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
from .messages.decoder import values_reader
from .messages.definition import message_definition
from .messages.image_message import read_image_message
from .new_case import TrackedBody, write_case
from .new_manifest import write_case_manifest, write_live_manifest
from .readers.igsio.header import read_igsio
from .readers.mrml.recording import read_mrml
from .readers.recording_format import RecordingFormat, SideTopics, has_ending
from .readers.registry import read_recording, recording_formats, recording_kinds
from .readers.rosbag2.frames import read_mcap
from .recorder.bag_writer import BagTopic, BagWriter
from .recorder.recorder import Recorder, write_recording
from .schemas import DOCUMENTS, schema_text
from .session_values import RegistrationValues, SessionValues, received_values, sent_values
from .tumor import (
    SEGMENTATION_ENDING,
    BuiltTumor,
    tumor_from_contour,
    tumor_from_segmentation,
)

__all__ = [
    "DOCUMENTS",
    "IMAGE_DEPTH_TOPIC",
    "MAX_DEPTH_MM",
    "MAX_NEEDLE_MM",
    "MAX_STYLUS_SIGMA_MM",
    "MIN_NEEDLE_MM",
    "MIN_STYLUS_MM",
    "RECORDING_FOLDER",
    "SEGMENTATION_ENDING",
    "TUMOR_MESH_FRAME",
    "ApproachEntry",
    "BagTopic",
    "BagWriter",
    "BoxEntry",
    "BuiltTumor",
    "Case",
    "CaseImages",
    "CaseManifest",
    "CauteryState",
    "CauteryTrail",
    "ClockEntry",
    "ContourEntry",
    "CurrentImage",
    "DepthCalibration",
    "DistanceEntry",
    "Dwell",
    "EdgeCount",
    "EnvelopeEntry",
    "Expected",
    "ExpectedBreach",
    "ExpectedBreaches",
    "ExpectedDropout",
    "ExpectedRegistration",
    "IgtlSourceEntry",
    "ImageDepths",
    "ImageHeader",
    "ImagePose",
    "ImageSequence",
    "ImageSource",
    "ImagesEntry",
    "JointSample",
    "LiveCase",
    "LiveSourceEntry",
    "MarginEntry",
    "MeshEntry",
    "MeshOwner",
    "MotionEntry",
    "NeedleEntry",
    "PlausibilityEntry",
    "Playback",
    "PlayedSamples",
    "Player",
    "PoseHistory",
    "Provenance",
    "Recorder",
    "RecordingEntry",
    "RecordingFormat",
    "RecordingInventory",
    "RegistrationEntry",
    "RegistrationValues",
    "RobotEntry",
    "SegmentationEntry",
    "SessionValues",
    "SideTopics",
    "SphereEntry",
    "StylusEntry",
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
    "schema_text",
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
