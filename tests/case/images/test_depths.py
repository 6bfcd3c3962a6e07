"""Calibrations by imaging depth: which one places an image, and which images are refused."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from app.case import DepthCalibration, ImageDepths, open_case, open_case_images
from app.case.case_images import BagImages
from app.geometry import ImageCalibration, InputError, image_corners
from tests.case.images.sequences import CALIBRATION
from tests.case.images.test_bag_images import COLUMNS, COUNT, ROWS, case_with, image, stamp
from tests.refusals import refused

SHALLOW = np.vstack([CALIBRATION, (0, 0, 0, 1)])
DEEP = SHALLOW @ np.diag([1.5, 1.5, 1.5, 1.0])


def depths(start_mm: float = 40.0) -> ImageDepths:
    entries = [(40.0, SHALLOW), (60.0, DEEP)]
    return ImageDepths(
        [DepthCalibration(mm, ImageCalibration("probe", matrix)) for mm, matrix in entries],
        start_mm,
    )


def pixel_mm(matrix: Any, factor: float = 1.0) -> tuple[float, float]:
    width, height = np.linalg.norm(matrix[:3, :2], axis=0) * factor
    return float(width), float(height)


def test_depth_holds_for_images_stamped_after_its_choice():
    found = depths()
    found.choose(60.0, 100)
    found.choose(40.0, 200)
    assert [found.at(ns).depth_mm for ns in (-5, 100, 101, 200, 201)] == [40, 40, 60, 60, 40]
    found.choose(60.0, 150)  # an earlier time: the later choice is void
    assert [found.at(ns).depth_mm for ns in (150, 151, 201)] == [60, 60, 60]
    found.choose(40.0, 300)
    found.forget_times()
    assert found.at(0).depth_mm == found.depth_mm == 40.0


def test_size_of_the_pixels_tells_the_depth():
    found = depths()
    for factor in (0.985, 1.0, 1.015):  # a device states it otherwise than the calibration
        found.check(0, pixel_mm(SHALLOW, factor))
    found.check(0, None)
    with pytest.raises(InputError) as caught:
        found.check(0, pixel_mm(DEEP))
    assert str(caught.value) == (
        "image has pixels of 0.1281 x 0.1185 mm, those of depth 60 mm; expected those of depth 40 "
        "mm (0.08541 x 0.07901 mm), which is in use: choose depth 60 mm"
    )
    with pytest.raises(InputError) as caught:
        found.check(0, (1.0, 1.0))
    assert str(caught.value) == (
        "image has pixels of 1 x 1 mm; expected those of a listed depth: depth 40 mm (0.08541 x "
        "0.07901 mm), depth 60 mm (0.1281 x 0.1185 mm)"
    )
    found.choose(60.0, 10)
    found.check(11, pixel_mm(DEEP))
    found.check(10, pixel_mm(SHALLOW))
    with pytest.raises(InputError, match="choose depth 40 mm"):
        found.check(11, pixel_mm(SHALLOW))


@pytest.mark.parametrize("depth_mm", [50.0, float("nan"), -40.0])
def test_depth_that_is_not_listed_is_refused(depth_mm):
    found = depths()
    with pytest.raises(InputError, match=r"^depth of the images: .* mm; expected one of 40, 60$"):
        found.choose(depth_mm, 0)
    assert found.depth_mm == 40.0
    with pytest.raises(InputError, match="expected one of none: one calibration"):
        ImageDepths.one(ImageCalibration("probe", SHALLOW)).choose(40.0, 0)


LISTED = [
    {"depth_mm": 60, "path": "image_to_probe.txt"},
    {"depth_mm": 40, "matrix": SHALLOW.ravel().tolist()},
]


def case_of(folder: Path, chosen: dict[int, float] | None = None, **changes: object) -> BagImages:
    """A case whose bag has the depths ``chosen``: ns -> mm."""
    entry = {"calibration": None, "calibrations": LISTED, "depth_mm": 40, **changes}
    case = case_with(folder, [image(n) for n in range(COUNT)], chosen_depths=chosen or {}, **entry)
    found = open_case_images(case)
    assert isinstance(found, BagImages)
    return found


def test_replay_places_each_image_by_the_depth_that_was_in_use_at_its_stamp(tmp_path):
    images = case_of(tmp_path / "case", {stamp(3): 60.0, stamp(7) + 1: 40.0})
    file = np.loadtxt(tmp_path / "case" / "image_to_probe.txt").reshape(4, 4)
    for number in range(COUNT):
        found = images.at(stamp(number), "tracker")
        is_deep = 3 < number <= 7
        assert found.depth_mm == (60.0 if is_deep else 40.0)
        matrix = file if is_deep else SHALLOW
        columns = np.array([0, COLUMNS - 1, COLUMNS - 1, 0])[:, None]
        rows = np.array([0, 0, ROWS - 1, ROWS - 1])[:, None]
        moved = np.array([5.0 + 30.0 * number, 0.0, 0.0])  # mm, of the probe
        corners = columns * matrix[:3, 0] + rows * matrix[:3, 1] + matrix[:3, 3] + moved
        assert found.pose.matrix is not None
        np.testing.assert_allclose(
            image_corners(found.pose.matrix, COLUMNS, ROWS), corners, rtol=0, atol=1e-6
        )


def test_depths_of_a_recording_are_copied_with_it(tmp_path):
    from app.case import convert_case

    case_of(tmp_path / "case", {stamp(3): 60.0})
    convert_case(open_case(tmp_path / "case"), tmp_path / "copy")
    copied = open_case_images(open_case(tmp_path / "copy"))
    assert copied is not None
    assert [copied.at(stamp(n), "tracker").depth_mm for n in (3, 4)] == [40.0, 60.0]


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"depth_mm": 50}, "images.depth_mm is 50; expected one of calibrations: 60, 40"),
        ({"depth_mm": None}, "images.depth_mm is missing"),
        ({"calibration": "a.xml"}, "images has calibration and calibrations; expected one of them"),
        ({"calibrations": []}, "give calibration for a probe with one depth"),
        ({"calibrations": [LISTED[1], LISTED[1]]}, "depth_mm 40 is listed twice"),
        ({"calibrations": None}, "images.depth_mm is given; expected calibrations with it"),
        ({"calibrations": [{"depth_mm": 40}]}, "calibrations[0] has neither of path and matrix"),
        ({"calibrations": [LISTED[0] | LISTED[1]]}, "calibrations[0] has both of path and matrix"),
        ({"calibrations": [{"depth_mm": 40, "path": "none.xml"}]},
         "images.calibrations, 40 mm is 'none.xml': no such file"),
        ({"calibrations": [{"depth_mm": 40, "matrix": [0.0] * 16}]},
         "images.calibrations, 40 mm: probe_from_image: its last row is"),
    ],
)  # fmt: skip
def test_invalid_depths_of_a_case_are_refused_in_one_line(tmp_path, changes, expected):
    with refused(text=expected):
        case_of(tmp_path / "case", **changes)


def test_recorded_depth_that_is_not_listed_is_refused(tmp_path):
    with pytest.raises(InputError, match="depth of the images: 70 mm; expected one of 40, 60"):
        case_of(tmp_path / "case", {stamp(3): 70.0})


def test_calibration_of_a_case_can_still_be_one(tmp_path):
    images = case_of(
        tmp_path / "a", calibration="image_to_probe.txt", calibrations=None, depth_mm=None
    )
    assert images.at(stamp(3), "tracker").depth_mm is None
    values = yaml.safe_load((tmp_path / "a" / "case.yaml").read_text())["images"]
    assert "calibrations" not in values
