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
from app.case.recorder import Recorder, write_recording
from app.case.samples import JointSample, TrackingFrame
from app.case.watchdog import with_watchdog

__all__ = [
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
    "Provenance",
    "Recorder",
    "RecordingEntry",
    "RecordingInventory",
    "RegistrationEntry",
    "RobotEntry",
    "ToolEntry",
    "TrackingFrame",
    "TumorEntry",
    "convert_case",
    "load_expected",
    "load_manifest",
    "load_mesh",
    "open_case",
    "read_igsio",
    "read_mcap",
    "with_watchdog",
    "write_expected",
    "write_recording",
]
