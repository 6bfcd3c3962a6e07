"""The images of a case: which one is current at a time, and why none is."""

from pathlib import Path

import numpy as np
import pytest

from app.case import CaseImages, open_case, open_case_images
from tests.case.images.ultrasound_case import (
    COLUMNS,
    INVALID,
    LOST,
    PROBE_FROM_IMAGE,
    ROWS,
    write_ultrasound_case,
)
from tests.refusals import refused

FIRST_NS, PERIOD_NS = 100_000_000_000, 50_000_000


def images_of(folder: Path, **changes: object) -> CaseImages:
    found = open_case_images(open_case(write_ultrasound_case(folder / "case", **changes)))
    assert found is not None
    return found


def test_newest_image_is_current_in_the_frame_of_the_needle(tmp_path):
    images = images_of(tmp_path)
    assert (len(images.sequence), images.sequence.size) == (40, (COLUMNS, ROWS))
    found = images.at(FIRST_NS + 4 * PERIOD_NS + 1, "needle")
    assert (found.number, found.pose.problem) == (4, "")
    needle = np.eye(4)
    needle[0, 3] = 0.001  # that of frame 4 of the recording
    expected = np.linalg.inv(needle) @ np.vstack([PROBE_FROM_IMAGE, (0, 0, 0, 1)])
    np.testing.assert_allclose(found.pose.matrix, expected, rtol=0, atol=1e-9)
    images.close()


@pytest.mark.parametrize(
    ("now_ns", "problem"),
    [
        (FIRST_NS - 1, "no image yet"),
        (FIRST_NS + INVALID * PERIOD_NS, "image 7 has status INVALID"),
        (FIRST_NS + LOST * PERIOD_NS, "image 9: tracker -> probe is OUT_OF_VIEW"),
        (FIRST_NS + 39 * PERIOD_NS + 200_000_000, ""),
        (
            FIRST_NS + 39 * PERIOD_NS + 200_000_001,
            "image 39 is 200 ms old; expected at most 200 ms",
        ),
    ],
)
def test_image_that_may_not_be_shown_has_no_place(tmp_path, now_ns, problem):
    images = images_of(tmp_path)
    found = images.at(now_ns, "tracker")
    assert found.pose.problem == problem
    assert (found.pose.matrix is None) == bool(problem)
    images.close()


def test_own_limit_of_the_age(tmp_path):
    images = images_of(tmp_path, stale_after_ms=20)
    found = images.at(FIRST_NS + 39 * PERIOD_NS + 20_000_001, "tracker")
    assert found.pose.problem == "image 39 is 20 ms old; expected at most 20 ms"
    images.close()


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"probe": "rdo"}, "images.probe is 'rdo': no image with a time has its pose"),
        ({"calibration": "none.xml"}, "images.calibration is 'none.xml': no such file"),
        ({"path": "none.igs.mha"}, "images.path is 'none.igs.mha': no such file"),
        ({"path": "rod.stl"}, "rod.stl"),
        ({"orientation": "UF"}, "is MF; expected no other (UF)"),
        ({"probes": "probe"}, "did you mean 'probe'?"),
    ],
)
def test_images_that_cannot_be_used_are_found_when_the_case_is_opened(tmp_path, changes, expected):
    folder = write_ultrasound_case(tmp_path / "case", **changes)
    with refused(text=expected):
        open_case(folder)
