"""``marginguard record`` keeps images, and the case that it writes shows them again."""

import json
import time
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader

from app.case import open_case, open_case_images
from app.case.case_images import BagImages
from benchmarks.images.sender import image_values
from benchmarks.images.session import COLUMNS, PROBE_FROM_IMAGE, ROWS, TOPIC, write_session
from tests.bridge.conftest import Start
from tests.waiting import wait_until

pytestmark = pytest.mark.slow

ENOUGH_BYTES = 3_000_000


def wait_for_images(folder: Path) -> None:
    """Wait until the recording holds some ten images, which do not compress."""
    wait_until(lambda: sum(path.stat().st_size for path in folder.glob("*.mcap")) > ENOUGH_BYTES)


@pytest.fixture
def recorded(start: Start, tmp_path: Path) -> Path:
    config = write_session(tmp_path / "session")
    case = tmp_path / "case"
    recorder = start("-m", "app.cli", "record", "-o", str(case), "--config", str(config))
    start("-m", "benchmarks.images.sender")
    recorder.line(lambda line: line == f"recording {TOPIC}\n")
    wait_for_images(case / "tracking")
    recorder.stop()
    return case


def test_depth_that_a_session_notes_is_that_of_the_replay(start, tmp_path):
    """The line is the one that a session writes when an operator has chosen a depth."""
    matrix = PROBE_FROM_IMAGE @ np.diag([1.5, 1.5, 1.5, 1.0])
    calibrations = [
        {"depth_mm": 40, "path": "image_to_probe.txt"},
        {"depth_mm": 60, "matrix": matrix.ravel().tolist()},
    ]
    config = write_session(tmp_path / "session", calibrations=calibrations, depth_mm=40)
    case = tmp_path / "case"
    arguments = ("record", "-o", str(case), "--config", str(config), "--until-eof")
    recorder = start("-m", "app.cli", *arguments)
    start("-m", "benchmarks.images.sender")
    recorder.line(lambda line: line == f"recording {TOPIC}\n")
    chosen_ns = time.time_ns()
    recorder.send(json.dumps({"image_depth": [60.0, chosen_ns]}))
    recorder.line(lambda line: line == "depth of the images: 60 mm\n")
    wait_for_images(case / "tracking")
    recorder.end_input()
    assert recorder.wait() == 0
    images = open_case_images(open_case(case))
    assert isinstance(images, BagImages)
    depths = {40.0: 0, 60.0: 0}
    for number in range(len(images)):
        sample = images.image(number)
        assert sample.stamp is not None
        found = images.at(sample.stamp.ns, "reference")
        if found.pose.matrix is None:  # poses around the first and the last may be missing
            continue
        expected_mm = 60.0 if sample.stamp.ns > chosen_ns else 40.0
        assert found.depth_mm == expected_mm
        expected = matrix if expected_mm == 60.0 else PROBE_FROM_IMAGE
        np.testing.assert_allclose(found.pose.matrix, expected, rtol=0, atol=0.5)
        depths[expected_mm] += 1
    assert depths[60.0] >= 5


def test_recorded_images_are_shown_again(recorded):
    images = open_case_images(open_case(recorded))
    assert isinstance(images, BagImages)
    assert images.size == (COLUMNS, ROWS)
    expected = {image_values(number).tobytes() for number in range(16)}
    placed = 0
    for number in range(len(images)):
        sample = images.image(number)
        assert sample.pixels is not None and sample.stamp is not None
        assert sample.pixels.tobytes() in expected
        found = images.at(sample.stamp.ns, "reference").pose
        if found.matrix is not None:  # poses around the first and the last may be missing
            placed += 1
            np.testing.assert_allclose(found.matrix, PROBE_FROM_IMAGE, rtol=0, atol=0.5)
    assert placed >= 5
    (path,) = (recorded / "tracking").glob("*.mcap")
    with path.open("rb") as file:
        schemas = {
            channel.topic: (schema.name, schema.encoding, channel.message_encoding)
            for schema, channel, _ in make_reader(file).iter_messages(topics=[TOPIC])
            if schema is not None
        }
    assert schemas == {TOPIC: ("sensor_msgs/msg/Image", "ros2msg", "cdr")}
