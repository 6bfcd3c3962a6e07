"""Reader of the recording of eight landmarks by PLUS, independent of `app.case` and `app.files`."""

import re
from pathlib import Path

import numpy as np
import yaml
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
    return tips_in(recording, stylus_from_tip), landmarks


def shipped_tips(case: Path) -> tuple[list[TrackedTransform], FloatArray]:
    """``reference_from_stylus_tip`` of the shipped recording, and a landmark (3,) in reference."""
    values = yaml.safe_load((case / "case.yaml").read_text())
    tip = np.array(values["tool"]["tip_from"]["matrix"])
    stylus_from_tip = Transform.from_matrix(tip, target="stylus", source="stylus_tip")
    landmark = np.array(values["tumor"]["pose"]["matrix"]).reshape(4, 4)[:3, 3]
    return tips_in(case / "tracking.igs.mha", stylus_from_tip), landmark


def tips_in(recording: Path, stylus_from_tip: Transform) -> list[TrackedTransform]:
    """``reference_from_stylus_tip`` of the header of a recording."""
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
    return samples
