from .bag.bag_writer import BagTopic, BagWriter
from .bag.mcap import read_mcap, values_reader
from .bag.message_definition import message_definition
from .bag.recorder import Recorder, write_recording
from .case import Case, open_case
from .convert import convert_case
from .files.landmarks import POINT_ENDINGS, read_landmarks
from .files.meshes import MESH_ENDINGS, UNITS_MM, check_mesh_place, load_mesh, write_mesh
from .files.plus_config import PlusConfiguration, read_plus_config
from .files.small import check_place, write_small
from .files.transforms import (
    TRANSFORM_ENDINGS,
    check_transform_path,
    read_transform,
    write_transform,
)
from .frames.assembly import agreed_sample
from .frames.inventory import EdgeCount, RecordingInventory
from .frames.player import Player
from .frames.samples import JointSample, TrackingFrame
from .frames.watchdog import with_watchdog
from .igsio import read_igsio
from .live_file import (
    IgtlSourceEntry,
    LiveCase,
    LiveSourceEntry,
    TfSourceEntry,
    TopicSourceEntry,
    open_live,
)
from .live_recording import RECORDING_FOLDER, begin_case
from .manifest.case_file import load_manifest
from .manifest.entries import (
    TUMOR_MESH_FRAME,
    CaseManifest,
    ClockEntry,
    ContourEntry,
    Dwell,
    MarginEntry,
    MeshEntry,
    Provenance,
    RecordingEntry,
    RegistrationEntry,
    RobotEntry,
    SegmentationEntry,
    ToolEntry,
    TumorEntry,
)
from .manifest.expected import (
    Expected,
    ExpectedBreach,
    ExpectedBreaches,
    ExpectedDropout,
    ExpectedRegistration,
    load_expected,
    write_expected,
)
from .manifest.sections import check_topic
from .mrml.files import MRML_ENDINGS
from .mrml.recording import read_mrml
from .tumor import (
    SEGMENTATION_ENDING,
    BuiltTumor,
    tumor_from_contour,
    tumor_from_segmentation,
)

__all__ = [
    "MESH_ENDINGS",
    "MRML_ENDINGS",
    "POINT_ENDINGS",
    "RECORDING_FOLDER",
    "SEGMENTATION_ENDING",
    "TRANSFORM_ENDINGS",
    "TUMOR_MESH_FRAME",
    "UNITS_MM",
    "BagTopic",
    "BagWriter",
    "BuiltTumor",
    "Case",
    "CaseManifest",
    "ClockEntry",
    "ContourEntry",
    "Dwell",
    "EdgeCount",
    "Expected",
    "ExpectedBreach",
    "ExpectedBreaches",
    "ExpectedDropout",
    "ExpectedRegistration",
    "IgtlSourceEntry",
    "JointSample",
    "LiveCase",
    "LiveSourceEntry",
    "MarginEntry",
    "MeshEntry",
    "Player",
    "PlusConfiguration",
    "Provenance",
    "Recorder",
    "RecordingEntry",
    "RecordingInventory",
    "RegistrationEntry",
    "RobotEntry",
    "SegmentationEntry",
    "TfSourceEntry",
    "ToolEntry",
    "TopicSourceEntry",
    "TrackingFrame",
    "TumorEntry",
    "agreed_sample",
    "begin_case",
    "check_mesh_place",
    "check_place",
    "check_topic",
    "check_transform_path",
    "convert_case",
    "load_expected",
    "load_manifest",
    "load_mesh",
    "message_definition",
    "open_case",
    "open_live",
    "read_igsio",
    "read_landmarks",
    "read_mcap",
    "read_mrml",
    "read_plus_config",
    "read_transform",
    "tumor_from_contour",
    "tumor_from_segmentation",
    "values_reader",
    "with_watchdog",
    "write_expected",
    "write_mesh",
    "write_recording",
    "write_small",
    "write_transform",
]
