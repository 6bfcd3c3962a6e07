"""Depths that an operator chooses are in the recording of the session, and its replay uses them."""

from dataclasses import replace

import numpy as np
import pytest

from app.bridge.live.non_ros_recorder import DepthRecorder
from app.case import IMAGE_DEPTH_TOPIC, BagTopic, BagWriter, DepthCalibration, ImageDepths
from app.case.case_images import RecordedDepth, recorded_depths
from app.geometry import ImageCalibration, ImageSample, ImageStatus, InputError, Stamp

pytestmark = pytest.mark.slow

PIXELS_MM = {40.0: 0.1, 60.0: 0.15}


class BagOnly:
    """TEST DOUBLE of `RosRecorder`: writes own topics to a bag."""

    def __init__(self, bag: BagWriter) -> None:
        self._bag = bag

    def add_own(self, topic: BagTopic) -> None:
        self._bag.add_topic(topic)

    def write_own(self, name: str, data: bytes) -> None:
        self._bag.write(name, data, received_ns=1, published_ns=1)


def depths() -> ImageDepths:
    return ImageDepths(
        [
            DepthCalibration(mm, ImageCalibration("probe", np.diag([pixel, pixel, pixel, 1.0])))
            for mm, pixel in PIXELS_MM.items()
        ],
        40.0,
    )


def image(at_ns: int, pixel_mm: float) -> ImageSample:
    sample = ImageSample(0, Stamp(at_ns), ImageStatus.OK, np.zeros((2, 2), np.uint8))
    return replace(sample, pixel_mm=(pixel_mm, pixel_mm))


def test_chosen_depths_are_read_from_the_bag_with_their_stamps(tmp_path):
    bag = BagWriter(tmp_path / "bag")
    recorder = DepthRecorder(BagOnly(bag), depths())
    assert recorder.write(60.0, 1_700_000_000_123_456_789) == "depth of the images: 60 mm"
    assert recorder.write(40.0, 1_700_000_001_000_000_000) == "depth of the images: 40 mm"
    assert "70 mm; expected one of 40, 60" in recorder.write(70.0, 1_700_000_002_000_000_000)
    bag.close()
    found = list(recorded_depths(tmp_path / "bag"))
    assert [each.from_ns for each in found] == [1_700_000_000_123_456_789, 1_700_000_001 * 10**9]
    assert [each.depth_mm for each in found] == pytest.approx([60.0, 40.0], abs=1e-5)
    replayed = depths()
    for each in found:
        assert isinstance(each, RecordedDepth)
        replayed.choose(each.depth_mm, each.from_ns)
    assert replayed.at(1_700_000_000_500_000_000).depth_mm == 60.0
    assert set(bag.counts) == {IMAGE_DEPTH_TOPIC}


def test_image_of_another_depth_than_that_of_its_stamp_is_not_recorded(tmp_path):
    bag = BagWriter(tmp_path / "bag")
    recorder = DepthRecorder(BagOnly(bag), depths())
    recorder.write(60.0, 1000)
    recorder.check(image(1000, 0.1))
    recorder.check(image(1001, 0.15))
    with pytest.raises(InputError, match="choose depth 40 mm"):
        recorder.check(image(1001, 0.1))
    bag.close()
