"""A repeated recording: the same samples, later, and nothing lost between two rounds."""

import numpy as np
import pytest

from app.case import Case, open_case
from app.geometry import NS_PER_S, FloatArray, TrackedTransform
from benchmarks.replay.long_case import write_long_case
from tests.shipped_case import SHIPPED_CASE as RECORDED

pytestmark = pytest.mark.long

MORE_S = 2.7
"""Difference in length between the repeated case and one round."""


def matrix(sample: TrackedTransform) -> FloatArray:
    return np.zeros((4, 4)) if sample.transform is None else sample.transform.matrix


@pytest.fixture(scope="module")
def long_case(tmp_path_factory: pytest.TempPathFactory) -> Case:
    folder = tmp_path_factory.mktemp("long") / "case"
    once = list(open_case(RECORDED).recorded_frames())
    round_s = (once[-1].stamp.ns - once[0].stamp.ns) / NS_PER_S
    write_long_case(folder, RECORDED, round_s + MORE_S)
    return open_case(folder)


def test_rounds_continue_at_the_recordings_period(long_case):
    frames = list(long_case.recorded_frames())
    once = list(open_case(RECORDED).recorded_frames())
    period_ns = once[-1].stamp.ns - once[-2].stamp.ns
    shift_ns = once[-1].stamp.ns + period_ns - once[0].stamp.ns
    again = frames[len(once) :]
    end_ns = once[-1].stamp.ns + round(MORE_S * NS_PER_S)
    assert frames[-1].stamp.ns <= end_ns < once[len(again)].stamp.ns + shift_ns
    assert [frame.stamp.ns for frame in frames[: len(once)]] == [f.stamp.ns for f in once]
    assert [f.stamp.ns - shift_ns for f in again] == [f.stamp.ns for f in once[: len(again)]]


def test_samples_and_joints_repeat_those_of_the_first_round(long_case):
    frames = list(long_case.recorded_frames())
    once = list(open_case(RECORDED).recorded_frames())
    shift_ns = frames[len(once)].stamp.ns - once[0].stamp.ns
    for later, first in zip(frames[len(once) + 1 :], once[1:], strict=False):
        assert later.joints[-1].stamp.ns - shift_ns == first.joints[-1].stamp.ns
        assert later.joints[-1].positions == first.joints[-1].positions
        for pose, known in zip(later.poses, first.poses, strict=True):
            assert (pose.source, pose.status) == (known.source, known.status)
            np.testing.assert_allclose(matrix(pose), matrix(known), rtol=0.0, atol=1e-9)


def test_expected_results_are_dropped(long_case):
    assert long_case.expected() is None
    assert long_case.manifest.recorded().sha256 is None
