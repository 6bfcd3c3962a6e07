"""Recorded cases: manifest, readers of IGSIO and MCAP recordings, recorder, player."""

from app.case.case import Case, open_case
from app.case.convert import convert_case
from app.case.expected import (
    Expected,
    ExpectedBreach,
    ExpectedBreaches,
    ExpectedDropout,
    ExpectedRegistration,
    load_expected,
    write_expected,
)
from app.case.igsio import read_igsio
from app.case.inventory import EdgeCount, RecordingInventory
from app.case.landmark_file import read_landmarks
from app.case.manifest import (
    CaseManifest,
    ClockEntry,
    Dwell,
    MarginEntry,
    MeshEntry,
    Provenance,
    RecordingEntry,
    RegistrationEntry,
    RobotEntry,
    ToolEntry,
    TumorEntry,
)
from app.case.manifest_file import load_manifest
from app.case.mcap import read_mcap
from app.case.mesh_file import load_mesh
from app.case.player import Player
from app.case.plus_config import PlusConfiguration, read_plus_config
from app.case.recorder import Recorder, write_recording
from app.case.samples import JointSample, TrackingFrame
from app.case.small_file import check_place, write_small
from app.case.transform_file import (
    TRANSFORM_ENDINGS,
    check_transform_path,
    read_transform,
    write_transform,
)
from app.case.watchdog import with_watchdog

__all__ = [
    "TRANSFORM_ENDINGS",
    "Case",
    "CaseManifest",
    "ClockEntry",
    "Dwell",
    "EdgeCount",
    "Expected",
    "ExpectedBreach",
    "ExpectedBreaches",
    "ExpectedDropout",
    "ExpectedRegistration",
    "JointSample",
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
    "ToolEntry",
    "TrackingFrame",
    "TumorEntry",
    "check_place",
    "check_transform_path",
    "convert_case",
    "load_expected",
    "load_manifest",
    "load_mesh",
    "open_case",
    "read_igsio",
    "read_landmarks",
    "read_mcap",
    "read_plus_config",
    "read_transform",
    "with_watchdog",
    "write_expected",
    "write_recording",
    "write_small",
    "write_transform",
]
