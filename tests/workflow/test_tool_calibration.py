"""Guided calibration of the session's tool: poses of steps, the fit, acceptance and undo."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from app.fixture import Reason
from app.geometry import InputError, Transform
from app.registration import calibrate_pivot, select_pivot_poses
from app.runtime import SetTip
from app.workflow import CalibrationKind, Phase, ToolCalibration, fit_calibration
from app.workflow.tool_calibration import MAX_POSES
from tests.session_content import one_link_content
from tests.workflow.guided import (
    PERIOD_MS,
    Guided,
    edges_of,
    pivot_rotation,
    spin_rotation,
    step_with,
)

pytestmark = pytest.mark.slow

CONTENT = one_link_content()
TIP_MM, DIVOT_MM = np.array([6.0, -3.0, 118.0]), np.array([50.0, 40.0, 30.0])
SHAFT = np.array([0.1, 0.05, 1.0]) / np.linalg.norm([0.1, 0.05, 1.0])
EAST = np.array([1.0, 0.0, 0.0])
PIVOT, SPIN = CalibrationKind.PIVOT, CalibrationKind.SPIN


def with_tip(content, command):
    """``content`` after ``command``."""
    assert isinstance(command, SetTip)
    others = [e for e in content.static_edges if e.source != "cautery_tip"]
    edges = (*others, command.tool_from_tip)
    return replace(content, static_edges=edges, tip_sigma_mm=command.sigma_mm)


class GuidedTool(Guided):
    """A calibration with the steps of a session whose tip is in the divot."""

    def __init__(self, content=CONTENT):
        super().__init__(ToolCalibration, content, fit_calibration, with_tip)
        self.rng = np.random.default_rng(5)
        self.at_ms = 0

    def observe(self, rotation, *, reasons=(), target="reference", lost=False, slid_mm=0.0):
        self.at_ms += PERIOD_MS
        noisy = rotation * Rotation.from_rotvec(self.rng.normal(0.0, 0.001, 3))
        place = DIVOT_MM - rotation.apply(TIP_MM) + self.rng.normal(0.0, 0.1, 3)
        pose = Transform(target, "cautery", noisy.as_matrix(), place + slid_mm * EAST)
        edges = edges_of(pose, at_ms=self.at_ms)
        if lost:
            edges.measured[target, "cautery"] = None
        self.guide.observe(step_with(edges, reasons))
        return pose

    def begin(self, count, kind=PIVOT, rotation_of=pivot_rotation):
        """Start a recording with ``count`` poses; return them."""
        self.guide.start(self.seen, kind)
        return [self.observe(rotation_of(number)) for number in range(count)]

    def record(self, kind=PIVOT, rotation_of=pivot_rotation, count=300):
        poses = self.begin(count, kind, rotation_of)
        self.stop()
        return poses


@pytest.fixture
def guided():
    return GuidedTool()


def test_accepted_pivot_is_the_tip_of_the_session_with_its_uncertainty_and_undone(guided):
    before = guided.content
    poses = guided.record()
    status = guided.guide.status()
    assert (status.samples, status.can_accept, status.problem) == (300, True, "")
    # The checks of the command, by the same functions.
    expected = calibrate_pivot([poses[index] for index in select_pivot_poses(poses)])
    assert status.fit.reason == expected.reason
    guided.accept()
    tip = guided.content.tool_from_tip
    np.testing.assert_allclose(tip.translation_mm, expected.tip_mm, atol=1e-9)
    assert np.linalg.norm(tip.translation_mm - TIP_MM) < 0.5
    np.testing.assert_array_equal(tip.rotation, before.tool_from_tip.rotation)
    assert 0.0 < guided.content.tip_sigma_mm <= expected.tip_sigma_mm
    assert guided.guide.status().phase is Phase.IDLE
    assert guided.guide.can_undo
    guided.undo()
    assert guided.content.tool_from_tip is before.tool_from_tip
    assert guided.content.tip_sigma_mm == before.tip_sigma_mm
    assert not guided.guide.can_undo


def test_spin_turns_the_axis_and_leaves_tip_and_uncertainty(guided):
    guided.record()
    guided.accept()
    pivoted = guided.content
    guided.record(SPIN, lambda number: spin_rotation(number, SHAFT))
    fit = guided.guide.status().fit
    assert fit.coverage.sectors == (True,) * 8
    guided.accept()
    tip = guided.content.tool_from_tip
    np.testing.assert_array_equal(tip.translation_mm, pivoted.tool_from_tip.translation_mm)
    assert np.degrees(np.arccos(tip.rotation[:, 2] @ SHAFT)) < 0.5
    assert guided.content.tip_sigma_mm == pivoted.tip_sigma_mm
    # The smallest rotation: no rotation about the axis is added.
    assert fit.turn_rad == pytest.approx(np.arccos(SHAFT[2]), abs=0.01)
    for _ in range(2):
        guided.undo()
    assert guided.content.tool_from_tip is CONTENT.tool_from_tip


@pytest.mark.parametrize(
    ("count", "cone_rad", "reason", "advice"),
    [
        (4, 0.6, "expected at least 10 that differ", "tilt the tool slowly to all sides"),
        (300, 0.1, "rotate by at most", "tilt the tool slowly to all sides"),
        (300, 0.19, "the shaft swings over", "continue, in the directions"),
    ],
    ids=["few poses", "no tilt", "narrow cone"],
)
def test_reason_why_a_pivot_is_not_good_enough(guided, count, cone_rad, reason, advice):
    guided.record(PIVOT, lambda number: pivot_rotation(number, cone_rad), count)
    fit = guided.guide.status().fit
    assert not fit.accepted
    assert reason in fit.reason
    assert advice in fit.advice
    with pytest.raises(InputError, match=f"calibration: .*{reason}"):
        guided.accept()
    assert guided.content is CONTENT


def test_tip_that_slides_is_refused(guided):
    guided.guide.start(guided.seen, PIVOT)
    for number in range(300):
        guided.observe(pivot_rotation(number), slid_mm=0.3 * (number + 1))
    assert not guided.stop().accepted


def test_coverage_grows_with_the_poses(guided):
    guided.guide.start(guided.seen, PIVOT)
    covered = []
    for number in range(150):
        guided.observe(pivot_rotation(number))
        covered.append(sum(guided.fit().coverage.sectors) if number % 30 == 29 else 0)
    covered = covered[29::30]
    assert covered[0] < covered[-1] == 8
    assert covered == sorted(covered)


def test_tool_without_a_tip_gets_the_line_to_it_as_axis_and_no_spin_before():
    edges = [e for e in CONTENT.static_edges if e.source != "cautery_tip"]
    unknown = Transform.identity("cautery", "cautery_tip")
    guided = GuidedTool(replace(CONTENT, static_edges=(*edges, unknown)))
    with pytest.raises(InputError, match="expected a pivot calibration before"):
        guided.guide.start(guided.seen, SPIN)
    guided.record()
    guided.accept()
    axis = guided.content.tool_from_tip.rotation[:, 2]
    assert np.degrees(np.arccos(axis @ TIP_MM / np.linalg.norm(TIP_MM))) < 0.5


def test_doubted_lost_and_repeated_poses_are_not_recorded(guided):
    guided.guide.start(guided.seen, PIVOT)
    guided.observe(pivot_rotation(0), reasons=(Reason.SECOND_SENDER,))
    assert guided.guide.status().problem == Reason.SECOND_SENDER.text
    guided.observe(pivot_rotation(0), lost=True)
    assert "cautery" in guided.guide.status().problem
    guided.observe(pivot_rotation(1))
    assert (guided.guide.status().problem, guided.guide.status().samples) == ("", 1)
    guided.at_ms -= PERIOD_MS
    guided.observe(pivot_rotation(1))
    assert guided.guide.status().samples == 1


def test_reference_is_the_trackers_frame_where_none_is_tracked(guided):
    guided.guide.start(guided.seen, PIVOT)
    guided.observe(pivot_rotation(0), target="tracker")
    assert guided.guide.status().samples == 1
    assert guided.guide.task() is None  # a fit follows after some more
    for number in range(5):
        guided.observe(pivot_rotation(number), target="tracker")
    assert guided.guide.task().reference == "tracker"


def test_recording_is_bounded(guided, monkeypatch):
    monkeypatch.setattr("app.workflow.tool_calibration.MAX_POSES", 20)
    assert MAX_POSES == 6000
    guided.begin(25)
    status = guided.guide.status()
    assert status.samples == 20
    assert "20 poses are recorded" in status.problem


def test_change_of_another_page_is_refused_and_loses_nothing(guided):
    guided.record()
    old = guided.seen - 1
    for change in (
        lambda: guided.guide.start(old, PIVOT),
        lambda: guided.guide.stop(old),
        lambda: guided.guide.discard(old),
        lambda: guided.guide.accept(old),
        lambda: guided.guide.undo(old),
    ):
        with pytest.raises(InputError, match="another page has changed it meanwhile"):
            change()
    assert guided.guide.status().can_accept


def test_requests_in_a_wrong_phase_are_refused_in_one_line(guided):
    with pytest.raises(InputError, match="nothing is recorded"):
        guided.guide.stop(guided.seen)
    with pytest.raises(InputError, match="no recording has been stopped"):
        guided.accept()
    with pytest.raises(InputError, match="did not replace another one here"):
        guided.guide.undo(guided.seen)
    guided.guide.start(guided.seen, PIVOT)
    guided.guide.stop(guided.seen)
    with pytest.raises(InputError, match="no pose was recorded"):
        guided.accept()
    guided.guide.discard(guided.seen)
    guided.begin(9)
    guided.guide.stop(guided.seen)
    with pytest.raises(InputError, match="it is being computed"):
        guided.accept()


def test_tip_that_the_session_refuses_stays_to_be_accepted_again(guided):
    guided.record()
    guided.uses = False
    with pytest.raises(InputError, match="the session is not ready"):
        guided.accept()
    guided.uses, guided.refuses_later = True, True
    guided.accept()
    assert guided.guide.status().can_accept
    assert not guided.guide.can_undo
    guided.refuses_later = False
    guided.accept()
    assert guided.guide.can_undo


def test_fit_of_an_earlier_recording_is_dropped(guided):
    guided.begin(40)
    task = guided.guide.task()
    guided.guide.start(guided.seen, PIVOT)
    guided.guide.use_fit(fit_calibration(task))
    assert guided.guide.status().fit is None


def test_undo_is_offered_only_for_the_tip_in_use(guided):
    guided.record()
    guided.accept()
    guided.guide.use_content(CONTENT)  # another program has replaced it
    assert not guided.guide.can_undo
