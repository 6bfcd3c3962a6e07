"""Guided pivot and spin of a stylus: the tip of a simulated motion, and that of the tool stays."""

from dataclasses import replace

import numpy as np
import pytest

from app.geometry import FrameError, InputError, Transform
from app.runtime import SetItemTip, ShownItem, tip_mm
from app.workflow import CalibrationKind, Phase, ToolCalibration, fit_calibration
from tests.session_content import one_link_content
from tests.workflow.guided import (
    PERIOD_MS,
    Guided,
    edges_of,
    pivot_rotation,
    spin_rotation,
    step_with,
)

CONTENT = replace(one_link_content(), items=(ShownItem("stylus", "stylus"),))
TIP_MM, DIVOT_MM = np.array([-4.0, 9.0, 152.0]), np.array([30.0, -20.0, 15.0])
SHAFT = TIP_MM / np.linalg.norm(TIP_MM)
PIVOT, SPIN = CalibrationKind.PIVOT, CalibrationKind.SPIN
STYLUS = "stylus"
EDGE = ("reference", "stylus")
NOISE_MM = 0.1


def with_tip(content, command):
    """``content`` after ``command``, which is for the stylus."""
    assert isinstance(command, SetItemTip)
    stylus = content.item("stylus").with_tip(command.frame_from_tip, command.sigma_mm)
    return content.with_item(stylus)


def stylus_pose(rotation, noise_mm=0.0):
    """Pose of the stylus' sensor with its tip in the divot."""
    return Transform(*EDGE, rotation.as_matrix(), DIVOT_MM - rotation.apply(TIP_MM) + noise_mm)


class GuidedStylus(Guided):
    """A calibration with the steps of a session with both tools; the cautery swings elsewhere."""

    def __init__(self, content=CONTENT):
        super().__init__(ToolCalibration, content, fit_calibration, with_tip)
        self.rng = np.random.default_rng(7)
        self.at_ms = 0

    def observe(self, rotation, *, is_stale=False, without=False):
        self.at_ms += PERIOD_MS
        stylus = stylus_pose(rotation, self.rng.normal(0.0, NOISE_MM, 3))
        cautery = Transform("reference", "cautery", rotation.as_matrix(), [200.0, 0.0, self.at_ms])
        edges = edges_of(stylus, cautery, at_ms=self.at_ms)
        if is_stale:
            edges.measured[EDGE] = None
        if without:
            del edges.measured[EDGE]
        self.guide.observe(step_with(edges))

    def begin(self, kind=PIVOT, rotation_of=pivot_rotation):
        self.guide.start(self.seen, kind, STYLUS)
        for number in range(300):
            self.observe(rotation_of(number))

    def record(self, *motion):
        self.begin(*motion)
        return self.stop()


@pytest.fixture
def guided():
    return GuidedStylus()


def test_pivot_finds_the_tip_of_the_motion_for_the_stylus_alone(guided):
    fit = guided.record()
    assert fit.accepted
    guided.accept()
    tip = guided.content.item("stylus").frame_from_tip
    error_mm = float(np.linalg.norm(tip.translation_mm - TIP_MM))
    assert error_mm < min(0.2, 4.0 * guided.content.item("stylus").sigma_mm)
    assert np.degrees(np.arccos(tip.rotation[:, 2] @ SHAFT)) < 0.1
    assert guided.content.tool_from_tip is CONTENT.tool_from_tip
    assert guided.content.tip_sigma_mm == CONTENT.tip_sigma_mm
    assert guided.guide.status().phase is Phase.IDLE
    assert not guided.guide.can_undo  # there was no tip before


def test_spin_follows_a_pivot_and_is_undone(guided):
    with pytest.raises(InputError, match=r"^spin: the tip of 'stylus' is at the sensor's origin"):
        guided.guide.start(guided.seen, SPIN, STYLUS)
    guided.record()
    guided.accept()
    pivoted = guided.content.item("stylus")
    guided.record(SPIN, lambda number: spin_rotation(number, SHAFT))
    guided.accept()
    assert guided.content.item("stylus").frame_from_tip is not pivoted.frame_from_tip
    assert guided.content.item("stylus").sigma_mm == pivoted.sigma_mm
    guided.undo()
    assert guided.content.item("stylus").frame_from_tip is pivoted.frame_from_tip
    assert not guided.guide.can_undo


def test_the_same_motion_gives_both_tools_the_same_tip(guided):
    guided.begin()
    task = guided.guide.task()
    tip = CONTENT.tool_from_tip
    known = Transform.identity(tip.target, tip.source)
    mine, cautery = fit_calibration(task), fit_calibration(replace(task, tool_from_tip=known))
    assert np.array_equal(mine.tool_from_tip.matrix, cautery.tool_from_tip.matrix)
    assert (mine.tool_from_tip.source, cautery.tool_from_tip.source) == ("stylus_tip", tip.source)
    assert (mine.sigma_mm, mine.reason) == (cautery.sigma_mm, cautery.reason)


@pytest.mark.parametrize("gap", [{"is_stale": True}, {"without": True}])
def test_a_stylus_that_is_stale_or_never_came_records_nothing_and_says_so(guided, gap):
    guided.guide.start(guided.seen, PIVOT, STYLUS)
    guided.observe(pivot_rotation(0), **gap)
    status = guided.guide.status()
    assert status.samples == 0
    assert "'stylus'" in status.problem
    guided.observe(pivot_rotation(1))
    guided.observe(pivot_rotation(2), **gap)
    status = guided.guide.status()
    assert (status.samples, "'stylus'" in status.problem) == (1, True)
    guided.guide.stop(guided.seen)
    with pytest.raises(InputError, match=r"^calibration: it is being computed"):
        guided.accept()


def test_a_session_without_a_stylus_says_so_in_one_line():
    guided = GuidedStylus(one_link_content())
    with pytest.raises(InputError, match=r"^stylus: the session has none; expected 'stylus' in"):
        guided.guide.start(guided.seen, PIVOT, STYLUS)
    assert guided.guide.status().phase is Phase.IDLE


def test_place_of_the_tip_is_that_of_the_motion(guided):
    guided.record()
    guided.accept()
    needle = Transform("reference", "needle", np.eye(3), [1.0, 2.0, 3.0])
    edges = edges_of(stylus_pose(pivot_rotation(12)), needle, at_ms=1)
    step = step_with(edges)
    found = tip_mm(step, guided.content, STYLUS, "needle")
    np.testing.assert_allclose(found, DIVOT_MM - [1.0, 2.0, 3.0], atol=0.3)
    stale = step_with(edges._replace(measured={**edges.measured, EDGE: None}))
    with pytest.raises(InputError, match=r"^stylus: 'stylus' in 'reference' is not known now;"):
        tip_mm(stale, guided.content, STYLUS, "needle")
    with pytest.raises(InputError, match=r"^stylus: it is not calibrated; expected a pivot"):
        tip_mm(step, CONTENT, STYLUS, "needle")
    with pytest.raises(FrameError):
        edges.between("needle", "cautery")
