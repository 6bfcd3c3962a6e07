"""Set-ups that cannot be right are named, sound ones are not; advice for every fault."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from app.case import TrackingFrame
from app.fixture import MarginState, Reason
from app.geometry import NS_PER_MS, Stamp, TrackedTransform, TrackingStatus, Transform
from app.runtime import ReplayRun, prepare_case
from app.session import ADVICE, SessionSetup, SetupDoubts, StepResult, advice_text
from tests.cli.small_case import write_small_case

pytestmark = pytest.mark.slow

PERIOD_NS = 50 * NS_PER_MS


@pytest.fixture(scope="module")
def setup(tmp_path_factory: pytest.TempPathFactory) -> SessionSetup:
    """The small case with a tip that is 5 mm from the sensor's origin."""

    def move_tip(manifest: dict) -> None:
        manifest["tool"]["tip_from"]["matrix"][11] = 5.0

    case = write_small_case(tmp_path_factory.mktemp("doubts") / "case", move_tip)
    return prepare_case(case, package_dirs=(), tip_only=False).setup


@pytest.fixture(scope="module")
def steps(setup: SessionSetup, tmp_path_factory: pytest.TempPathFactory) -> list[StepResult]:
    """Steps of the small case."""
    case = write_small_case(tmp_path_factory.mktemp("steps") / "case")
    prepared = prepare_case(case, package_dirs=(), tip_only=False)
    return list(ReplayRun(prepared, clock_ns=lambda: 0).steps())


Change = Callable[[int, StepResult], StepResult]


def doubts_of(
    setup: SessionSetup,
    steps: list[StepResult],
    *,
    period_ns: int = PERIOD_NS,
    moves_mm: float = 0.1,
    change: Change = lambda index, step: step,
    count: int = 300,
) -> tuple[str, ...]:
    """Doubts about ``count`` steps, with all sensors moving by ``moves_mm``."""
    doubts = SetupDoubts(setup)
    for index in range(count):
        stamp = Stamp(index * period_ns, "tracker")
        matrix = np.eye(4)
        matrix[0, 3] = moves_mm * (index % 7)
        poses = tuple(
            TrackedTransform(
                Transform.from_matrix(matrix, target="tracker", source=frame),
                stamp,
                TrackingStatus.OK,
            )
            for frame in ("rod", "needle")
        )
        step = replace(steps[index % 10], frame=TrackingFrame(stamp, poses))
        doubts.observe(change(index, step))
    return doubts.texts()


def test_sound_set_up_has_no_doubts(setup, steps):
    assert doubts_of(setup, steps) == ()


def test_tip_at_the_origin_of_the_sensor_is_named_at_once(setup, steps):
    identity = Transform.identity(setup.tool_from_tip.target, setup.tool_from_tip.source)
    wrong = replace(setup, tool_from_tip=identity)
    (text,) = SetupDoubts(wrong).observe(steps[0])
    assert "tool.tip_from: the tip is at the origin of the sensor 'rod'" in text


def test_tip_at_the_origin_of_a_tracked_tip_is_not_named(setup, steps):
    identity = Transform.identity("StylusTip", setup.tool_from_tip.source)
    assert SetupDoubts(replace(setup, tool_from_tip=identity)).observe(steps[0]) == ()


def test_tumor_that_is_metres_away_is_named_until_the_tool_is_near(setup, steps):
    def far(index: int, step: StepResult) -> StepResult:
        return _at_distance(step, 1500.0)

    (text,) = doubts_of(setup, steps, change=far)
    assert text.startswith("tumor: the tool is never nearer than 1.50 m; expected less than 1 m")
    once = doubts_of(setup, steps, change=lambda n, s: _at_distance(s, 1500.0 if n != 9 else 30.0))
    assert once == ()
    assert doubts_of(setup, steps, change=far, count=40) == ()


def _at_distance(step: StepResult, distance_mm: float) -> StepResult:
    proximity = step.decision.proximity
    assert proximity is not None
    rows = proximity.witnesses.rows.copy()
    rows[:, 0] = distance_mm
    far = type(proximity)(distance_mm, proximity.witnesses.of_rows(rows), None)
    return replace(step, decision=step.decision._replace(proximity=far))


def test_stale_limit_below_the_period_of_the_tracker_is_named(setup, steps):
    found = doubts_of(setup, steps, period_ns=250 * NS_PER_MS)
    assert len(found) == 2
    assert "margins.stale_after_ms: is 200; expected more than 250" in found[0]
    assert doubts_of(setup, steps, period_ns=150 * NS_PER_MS) == ()


def test_sensor_on_the_patient_that_never_moves_is_named(setup, steps):
    (text,) = doubts_of(setup, steps, moves_mm=0.001)
    assert text.startswith("frame 'needle': has not moved by 0.01 mm in 15 s")
    assert doubts_of(setup, steps, moves_mm=0.001, count=150) == ()


@pytest.mark.parametrize(("lost", "is_named"), [(5, False), (4, True)])
def test_share_of_unusable_frames_is_named_with_its_cause(setup, steps, lost, is_named):
    def lose(index: int, step: StepResult) -> StepResult:
        if index % lost:
            return step
        decision = step.decision._replace(
            state=MarginState.UNKNOWN, reasons=(Reason.INVALID, Reason.LATCHED)
        )
        return replace(step, decision=decision)

    found = doubts_of(setup, steps, change=lose)
    assert bool(found) is is_named
    if found:
        assert "25 % of 300 frames are unusable" in found[0]
        assert Reason.INVALID.text in found[0]


def test_shipped_case_has_no_doubts(project_root):
    prepared = prepare_case(project_root / "data/recorded_case", package_dirs=(), tip_only=True)
    run = ReplayRun(prepared, clock_ns=lambda: 0, end_s=16.0)
    assert [*run.steps()] and run.doubts.texts() == ()


def test_every_fault_has_advice_of_words():
    assert set(ADVICE) == {reason for reason in Reason if reason.is_fault} | {Reason.LATCHED}
    for reason in Reason:
        assert bool(advice_text([reason])) is reason.is_fault
    both = advice_text([Reason.MISSING, Reason.STALE, Reason.FROZEN, Reason.STOP_DISTANCE])
    assert both.startswith("Bring tool and sensors") and both.count(". ") == 1
