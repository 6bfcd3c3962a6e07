"""Recorded cases: manifest, readers, recorder, player."""

from app.case.expected import (
    Expected,
    ExpectedBreach,
    ExpectedBreaches,
    ExpectedDropout,
    ExpectedRegistration,
    load_expected,
    write_expected,
)
from app.case.recorder import Recorder, write_recording
from app.case.samples import JointSample, TrackingFrame

__all__ = [
    "Expected",
    "ExpectedBreach",
    "ExpectedBreaches",
    "ExpectedDropout",
    "ExpectedRegistration",
    "JointSample",
    "Recorder",
    "TrackingFrame",
    "load_expected",
    "write_expected",
    "write_recording",
]
