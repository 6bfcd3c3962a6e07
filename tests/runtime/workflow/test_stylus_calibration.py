"""Guided pivot and spin of a stylus: the tip of a simulated motion, and that of the tool stays."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from app.geometry import (
    NS_PER_MS,
    FrameError,
    InputError,
    Stamp,
    TrackedTransform,
    TrackingStatus,
    Transform,
)
from app.runtime import (
    CalibrationKind,
    Phase,
    Stylus,
    ToolCalibration,
    TrackedTool,
    fit_calibration,
    tip_mm,
)
from app.session import KnownEdges
from tests.session_content import one_link_content

CONTENT = replace(one_link_content(), stylus=Stylus("stylus"))
TIP_MM, DIVOT_MM = np.array([-4.0, 9.0, 152.0]), np.array([30.0, -20.0, 15.0])
SHAFT = TIP_MM / np.linalg.norm(TIP_MM)
PIVOT, SPIN = CalibrationKind.PIVOT, CalibrationKind.SPIN
CAUTERY, STYLUS = TrackedTool.CAUTERY, TrackedTool.STYLUS
NOISE_MM = 0.1


def pivot(number):
    tilt = 0.6 * (0.6 + 0.4 * np.sin(number / 23.0))
    return Rotation.from_rotvec(tilt * np.array([np.cos(number / 20), np.sin(number / 20), 0.0]))


def spin(number):
    return Rotation.from_rotvec([0.3, 0.2, 0.0]) * Rotation.from_rotvec(number / 40.0 * SHAFT)


class Guided:
    """A calibration, the steps of a session with both tools, and its use of a tip."""

    def __init__(self, content=CONTENT):
        self.content = content
        self.guide = ToolCalibration(content)
        self.rng = np.random.default_rng(7)
        self.at_ms = 0

    @property
    def seen(self):
        return self.guide.status().revision

    def observe(self, rotation, *, is_stale=False, without=False):
        """A step with the stylus' tip in the divot; the cautery swings about another point."""
        self.at_ms += 20
        stamp = Stamp(self.at_ms * NS_PER_MS)
        place = DIVOT_MM - rotation.apply(TIP_MM) + self.rng.normal(0.0, NOISE_MM, 3)
        stylus = Transform("reference", "stylus", rotation.as_matrix(), place)
        cautery = Transform("reference", "cautery", rotation.as_matrix(), [200.0, 0.0, self.at_ms])
        measured = {
            (each.target, each.source): TrackedTransform(each, stamp, TrackingStatus.OK)
            for each in (stylus, cautery)
        }
        if is_stale:
            measured["reference", "stylus"] = None
        if without:
            del measured["reference", "stylus"]
        edges = KnownEdges(measured=measured)
        self.guide.observe(SimpleNamespace(edges=edges, decision=SimpleNamespace(reasons=())))

    def record(self, kind, rotation_of):
        self.guide.start(self.seen, kind, STYLUS)
        for number in range(300):
            self.observe(rotation_of(number))
        self.guide.stop(self.seen)
        while (task := self.guide.task()) is not None:
            self.guide.use_fit(fit_calibration(task))
        return self.guide.status().fit

    def use(self, change):
        assert change.tool is STYLUS
        stylus = self.content.known_stylus.with_tip(change.tool_from_tip, change.sigma_mm)
        self.content = replace(self.content, stylus=stylus)
        return True

    def accept(self):
        self.guide.accept(self.seen, self.use)
        self.guide.use_content(self.content)


@pytest.fixture
def guided():
    return Guided()


def test_pivot_finds_the_tip_of_the_motion_for_the_stylus_alone(guided):
    fit = guided.record(PIVOT, pivot)
    assert fit.accepted
    guided.accept()
    tip = guided.content.stylus.frame_from_tip
    error_mm = float(np.linalg.norm(tip.translation_mm - TIP_MM))
    assert error_mm < min(0.2, 4.0 * guided.content.stylus.sigma_mm)
    assert np.degrees(np.arccos(tip.rotation[:, 2] @ SHAFT)) < 0.1
    assert guided.content.tool_from_tip is CONTENT.tool_from_tip
    assert guided.content.tip_sigma_mm == CONTENT.tip_sigma_mm
    assert guided.guide.status().phase is Phase.IDLE
    assert not guided.guide.can_undo  # there was no tip before


def test_spin_follows_a_pivot_and_is_undone(guided):
    with pytest.raises(InputError, match=r"^spin: the tip of 'stylus' is at the sensor's origin"):
        guided.guide.start(guided.seen, SPIN, STYLUS)
    guided.record(PIVOT, pivot)
    guided.accept()
    pivoted = guided.content.stylus
    guided.record(SPIN, spin)
    guided.accept()
    assert guided.content.stylus.frame_from_tip is not pivoted.frame_from_tip
    assert guided.content.stylus.sigma_mm == pivoted.sigma_mm
    guided.guide.undo(guided.seen, guided.use)
    guided.guide.use_content(guided.content)
    assert guided.content.stylus.frame_from_tip is pivoted.frame_from_tip
    assert not guided.guide.can_undo


def test_the_same_motion_gives_both_tools_the_same_tip(guided):
    guided.guide.start(guided.seen, PIVOT, STYLUS)
    for number in range(300):
        guided.observe(pivot(number))
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
    guided.observe(pivot(0), **gap)
    status = guided.guide.status()
    assert status.samples == 0
    assert "'stylus'" in status.problem
    guided.observe(pivot(1))
    guided.observe(pivot(2), **gap)
    status = guided.guide.status()
    assert (status.samples, "'stylus'" in status.problem) == (1, True)
    guided.guide.stop(guided.seen)
    with pytest.raises(InputError, match=r"^calibration: it is being computed"):
        guided.accept()


def test_a_session_without_a_stylus_says_so_in_one_line():
    guided = Guided(one_link_content())
    with pytest.raises(InputError, match=r"^stylus: the session has none; expected 'stylus' in"):
        guided.guide.start(guided.seen, PIVOT, STYLUS)
    assert guided.guide.status().phase is Phase.IDLE


def test_place_of_the_tip_is_that_of_the_motion(guided):
    guided.record(PIVOT, pivot)
    guided.accept()
    rotation = pivot(12)
    pose = Transform("reference", "stylus", rotation.as_matrix(), DIVOT_MM - rotation.apply(TIP_MM))
    needle = Transform("reference", "needle", np.eye(3), [1.0, 2.0, 3.0])
    edges = KnownEdges(
        measured={
            (each.target, each.source): TrackedTransform(each, Stamp(1), TrackingStatus.OK)
            for each in (pose, needle)
        }
    )
    step = SimpleNamespace(edges=edges, decision=SimpleNamespace(reasons=()))
    found = tip_mm(step, guided.content, STYLUS, "needle")
    np.testing.assert_allclose(found, DIVOT_MM - [1.0, 2.0, 3.0], atol=0.3)
    stale = replace(edges, measured={**edges.measured, ("reference", "stylus"): None})
    with pytest.raises(InputError, match=r"^stylus: 'stylus' in 'reference' is not known now;"):
        tip_mm(
            SimpleNamespace(edges=stale, decision=step.decision), guided.content, STYLUS, "needle"
        )
    with pytest.raises(InputError, match=r"^stylus: it is not calibrated; expected a pivot"):
        tip_mm(step, CONTENT, STYLUS, "needle")
    with pytest.raises(FrameError):
        edges.between("needle", "cautery")
