"""Logs of PerkTutor, compared with lxml arithmetic."""

from pathlib import Path

import numpy as np
import pytest
from lxml import etree

from app.case import read_recording
from app.case.readers.recording_format import format_of
from app.geometry import InputError, Transform


def log(*elements: str) -> str:
    return "<TransformRecorderLog>\n" + "\n".join(elements) + "\n</TransformRecorderLog>\n"


def element(device: str, time_ns: int, matrix: np.ndarray) -> str:
    seconds, nanoseconds = divmod(time_ns, 10**9)
    numbers = " ".join(f"{value:.6g}" for value in matrix.ravel())
    return (
        f'  <log TimeStampSec="{seconds}" TimeStampNSec="{nanoseconds}" type="transform" '
        f'DeviceName="{device}" transform="{numbers} " />'
    )


@pytest.fixture
def recorded(tmp_path: Path) -> Path:
    """Two devices, one after the other as PerkTutor writes them, and a message."""
    rng = np.random.default_rng(2)
    elements = []
    for device in ("NeedleToReference", "ProbeToReference"):
        for index in range(40):
            turn, place = rng.normal(size=3), rng.normal(0.0, 80.0, 3)
            pose = Transform.from_rotation_vector(turn, place, target="a", source="b")
            elements.append(element(device, 20_000_000 * index + 5, pose.matrix))
    message = '<log TimeStampSec="0" TimeStampNSec="7" type="message" message="Insertion" />'
    path = tmp_path / "TransformBuffer.xml"
    path.write_text(log(*elements, message))
    return path


def test_every_pose_equals_the_text(recorded):
    notes: list[str] = []
    frames = list(read_recording(recorded, notes.append))
    assert notes == ["1 messages of the log are not read"]
    assert len(frames) == 40
    found = {
        (pose.source, pose.target, pose.stamp.ns): pose.transform.matrix
        for frame in frames
        for pose in frame.poses
    }
    entries = etree.parse(recorded).findall("log[@type='transform']")
    assert len(entries) == len(found) == 80
    for entry in entries:
        source = entry.get("DeviceName").removesuffix("ToReference").lower()
        time = int(entry.get("TimeStampSec")) * 10**9 + int(entry.get("TimeStampNSec"))
        expected = np.array(entry.get("transform").split(), dtype=float).reshape(4, 4)
        # The reader projects the printed, rounded matrix to the nearest rotation.
        np.testing.assert_allclose(found[source, "reference", time], expected, atol=1e-5)


def test_other_xml_is_not_a_recording(tmp_path):
    path = tmp_path / "PlusDeviceSet.xml"
    path.write_text("<PlusConfiguration/>")
    with pytest.raises(InputError, match="is not a recording; expected one of"):
        format_of(path)


ONES = "1 " * 16


@pytest.mark.parametrize(
    ("seconds", "nanoseconds", "numbers", "message"),
    [
        (None, None, None, "holds no transform"),
        ("1", "2", "1 2", "element 2: transform has 2 numbers; expected 16"),
        ("x", "2", ONES, "element 2: TimeStampSec is 'x'; expected an integer"),
        ("1", "-2", ONES, "element 2: TimeStampNSec is '-2'; expected an integer"),
    ],
)
def test_malformed_log_is_refused_with_its_element(
    tmp_path, seconds, nanoseconds, numbers, message
):
    entry = (
        f'<log type="transform" DeviceName="AToB" TimeStampSec="{seconds}" '
        f'TimeStampNSec="{nanoseconds}" transform="{numbers}"/>'
    )
    path = tmp_path / "t.xml"
    path.write_text(log(entry if numbers else ""))
    with pytest.raises(InputError, match=message):
        list(read_recording(path, print))
