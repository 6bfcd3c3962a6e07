"""Images of a live session: which one is shown, and why none is."""

import numpy as np
import pytest

from app.case import DepthCalibration, ImageDepths
from app.geometry import (
    NS_PER_MS,
    FloatArray,
    ImageCalibration,
    ImageSample,
    ImageStatus,
    InputError,
    Stamp,
    TrackedTransform,
    TrackingStatus,
    Transform,
    image_corners,
)
from app.session import LiveImages

LIMIT_NS = 100 * NS_PER_MS
CALIBRATION = ImageCalibration("probe", np.diag([0.1, 0.2, 0.1, 1.0]))


def ns(ms: float) -> int:
    return round(ms * NS_PER_MS)


def image(at_ms: float, value: int = 0, size: tuple[int, ...] = (3, 4)) -> ImageSample:
    return ImageSample(0, Stamp(ns(at_ms)), ImageStatus.OK, np.full(size, value, np.uint8))


def pose(at_ms: float, x_mm: float = 0.0) -> TrackedTransform:
    transform = Transform("reference", "probe", np.eye(3), np.array([x_mm, 0.0, 0.0]))
    return TrackedTransform.valid(transform, Stamp(ns(at_ms)))


@pytest.fixture
def images() -> LiveImages:
    return LiveImages(ImageDepths.one(CALIBRATION), stale_after_ns=LIMIT_NS, max_gap_ns=LIMIT_NS)


def test_newest_image_is_placed_by_the_pose_at_its_own_stamp(images):
    images.add_poses([pose(1000, 0.0), pose(1040, 40.0)])
    images.add(image(1010, 7))
    found = images.at(ns(1060), "reference")
    assert found.number is not None and found.pose.matrix is not None
    np.testing.assert_allclose(found.pose.matrix[:3, 3], [10.0, 0, 0], rtol=0, atol=1e-9)
    np.testing.assert_allclose(np.diag(found.pose.matrix), [0.1, 0.2, 0.1, 1.0])
    assert images.size == (4, 3)
    assert images.image(found.number).pixels[0, 0] == 7


def test_image_waits_for_its_pose_and_the_one_before_it_is_shown(images):
    images.add_poses([pose(1000), pose(1020)])
    images.add(image(1010))
    images.add(image(1043))
    assert images.at(ns(1045), "reference").number == 0
    images.add_poses([pose(1060)])
    assert images.at(ns(1060), "reference").number == 1


def test_image_without_a_pose_is_not_shown(images):
    images.add_poses([pose(1000)])
    images.add(image(1040))
    found = images.at(ns(1050), "reference").pose
    assert found.matrix is None
    assert found.problem == "the newest pose of reference -> probe is 40 ms before the image"
    status = TrackingStatus.OUT_OF_VIEW
    images.add_poses([TrackedTransform.lost("reference", "probe", Stamp(ns(1050)), status)])
    assert images.at(ns(1050), "reference").pose.problem == "reference -> probe is OUT_OF_VIEW"


@pytest.mark.parametrize(
    ("now_ms", "problem"),
    [
        (1120, ""),
        (1120.001, "the image is 100 ms old; expected at most 100 ms"),
        (920, ""),
        (919, "the image is stamped 101 ms after the poses; expected at most 100 ms"),
    ],
)
def test_image_that_is_too_old_or_from_the_future_is_not_shown(images, now_ms, problem):
    images.add_poses([pose(1000), pose(1040)])
    images.add(image(1020))
    found = images.at(ns(now_ms), "reference").pose
    assert (found.problem, found.matrix is None) == (problem, bool(problem))


def test_refused_image_covers_until_a_good_one_arrives(images):
    images.add_poses([pose(1000), pose(1040)])
    images.add(image(1010))
    images.add(image(1020, size=(4, 4)))
    expected = (
        "image has pixels (4, 4) of uint8; expected (3, 4) of uint8, as the first one of the "
        "session"
    )
    assert images.at(ns(1030), "reference").pose.problem == expected
    images.add(image(1030))
    assert images.at(ns(1030), "reference").pose.problem == ""


def test_image_that_came_late_is_dropped_and_one_of_a_clock_set_back_starts_anew(images):
    images.add_poses([pose(1000), pose(1040)])
    images.add(image(1020))
    images.add(image(1010))
    images.add(image(1020))
    assert images.at(ns(1030), "reference").number == 0
    images.add_poses([pose(10), pose(30)])
    images.add(image(20))
    assert images.at(ns(30), "reference").number == 1
    with pytest.raises(InputError, match="image 0 is not held any more"):
        images.image(0)


DEPTHS_MM = {40.0: np.diag([0.1, 0.2, 0.1, 1.0]), 60.0: np.diag([0.15, 0.3, 0.15, 1.0])}


@pytest.fixture
def two_depths() -> LiveImages:
    calibrations = [
        DepthCalibration(depth_mm, ImageCalibration("probe", matrix))
        for depth_mm, matrix in DEPTHS_MM.items()
    ]
    depths = ImageDepths(calibrations, 40.0)
    return LiveImages(depths, stale_after_ns=LIMIT_NS, max_gap_ns=LIMIT_NS)


def corners_at(images: LiveImages, at_ms: float) -> tuple[float | None, FloatArray]:
    found = images.at(ns(at_ms), "reference")
    assert found.pose.matrix is not None, found.pose.problem
    return found.depth_mm, image_corners(found.pose.matrix, 4, 3)


def corners_of(depth_mm: float, x_mm: float) -> FloatArray:
    """By hand: pixels of the depth, moved along x."""
    width, height = DEPTHS_MM[depth_mm][0, 0], DEPTHS_MM[depth_mm][1, 1]
    ends = [(0, 0), (3 * width, 0), (3 * width, 2 * height), (0, 2 * height)]
    return np.array([(x_mm + x, y, 0.0) for x, y in ends])


def test_chosen_depth_places_images_that_are_stamped_later_and_no_others(two_depths):
    images = two_depths
    images.add_poses([pose(1000), pose(1100, 100)])
    images.add(image(1030))
    assert corners_at(images, 1040)[0] == 40.0
    images.choose_depth(60.0)  # the newest stamp is that of the last pose, 1100 ms
    for at_ms, depth_mm in ((1030, 40.0), (1090, 40.0), (1100, 40.0), (1101, 60.0)):
        if at_ms != 1030:  # an image that was acquired before the choice and comes after it
            images.add(image(at_ms))
            images.add_poses([pose(at_ms + 60, at_ms - 940.0)])
        shown_mm, corners = corners_at(images, at_ms)
        assert shown_mm == depth_mm
        np.testing.assert_allclose(corners, corners_of(depth_mm, at_ms - 1000), rtol=0, atol=1e-6)
    images.choose_depth(40.0)
    assert corners_at(images, 1101)[0] == 60.0  # it is shown already
    with pytest.raises(InputError, match="expected one of 40, 60"):
        images.choose_depth(50.0)


def test_depth_holds_for_all_images_after_the_clock_was_set_back(two_depths):
    two_depths.add_poses([pose(9000), pose(9040)])
    two_depths.choose_depth(60.0)
    two_depths.add_poses([pose(1000), pose(1040)])
    two_depths.add(image(1020))
    assert corners_at(two_depths, 1020)[0] == 60.0
    two_depths.add_poses([pose(9000), pose(9040)])
    two_depths.add(image(9020))
    two_depths.choose_depth(40.0)
    two_depths.add(image(1020))
    two_depths.add_poses([pose(1000), pose(1040)])
    assert corners_at(two_depths, 1020)[0] == 40.0


def test_no_image_yet(images):
    assert images.at(0, "reference").pose.problem == "no image yet"
    assert images.size is None
    images.add(ImageSample(0, None, ImageStatus.OK, np.zeros((3, 4), np.uint8)))
    assert "no stamp" in images.at(0, "reference").pose.problem


def test_memory_holds_the_last_images_only(images):
    for index in range(40):
        images.add(image(1000 + index))
    images.add_poses([pose(990), pose(1050)])
    assert images.at(ns(1040), "reference").number == 39
    assert images.image(32).stamp == Stamp(ns(1032))
    with pytest.raises(InputError):
        images.image(31)
