"""Reader of the recording of eight landmarks by PLUS, independent of `app.case` and `app.files`."""

import re
from pathlib import Path

import numpy as np
from lxml import etree

from app.geometry import FloatArray, Stamp, TrackedTransform, TrackingStatus, Transform


def numbers(text: str) -> FloatArray:
    return np.array(text.split(), dtype=float)


def recorded_tips(folder: Path) -> tuple[list[TrackedTransform], dict[str, FloatArray]]:
    """``reference_from_stylus_tip`` of the recording, and the phantom's landmarks."""
    configuration = etree.parse(folder / "PlusDeviceSet_fCal_Sim_RecordPhantomLandmarks.xml")
    tip = configuration.find(".//Transform[@From='StylusTip']").get("Matrix")
    stylus_from_tip = Transform.from_matrix(numbers(tip), target="stylus", source="stylus_tip")
    landmarks = {
        entry.get("Name"): numbers(entry.get("Position"))
        for entry in configuration.findall(".//Landmark")
    }
    recording = folder / "EightLandmarkPointsTrackedForPhantomRegistration.igs.mha"
    text = recording.read_text("latin-1")

    def field(name: str) -> list[str]:
        return re.findall(rf"Seq_Frame\d+_{name} = (.*)", text)

    samples = []
    for time, stylus, reference in zip(
        field("Timestamp"),
        field("StylusToTrackerTransform"),
        field("ReferenceToTrackerTransform"),
        strict=True,
    ):
        tracker_from_stylus = Transform.from_matrix(
            numbers(stylus), target="tracker", source="stylus"
        )
        tracker_from_reference = Transform.from_matrix(
            numbers(reference), target="tracker", source="reference"
        )
        pose = tracker_from_reference.inverse() @ tracker_from_stylus @ stylus_from_tip
        samples.append(TrackedTransform(pose, Stamp.from_seconds(time), TrackingStatus.OK))
    return samples, landmarks
