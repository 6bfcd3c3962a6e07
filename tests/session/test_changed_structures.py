"""Structures that are added, replaced, removed or changed in a running session; their velocity."""

from dataclasses import replace

import numpy as np
import pytest

from app.fixture import LimiterParameters, MarginParameterError, MarginState, Reason, limit_twist
from app.geometry import FrameError, TrackingStatus, Transform
from app.session import Role, Session, SessionSetup, Structure, off_line
from tests.doubles import PARAMETERS, AnalyticSphere, frame, lost, sample
from tests.refusals import refused
from tests.session.test_tumor_velocity import EXPECTED, breath, joints, make_setup

TIP = Transform.identity("cautery", "cautery_tip")


class Ball(AnalyticSphere):
    """A ball of a structure with this name, for a tool in any frame."""

    def __init__(self, radius_mm: float, name: str, tool: str | None = None) -> None:
        super().__init__(radius_mm)
        self.frames = (name, tool)


def ball(name: str, target: str, place_mm, **values) -> Structure:
    """A ball of 10 mm that stops at 2 mm."""
    given = {"stop_mm": 2.0, "warn_mm": 6.0, "sigma_mm": 0.3} | values
    pose = Transform(target, name, np.eye(3), place_mm)
    return Structure(pose, Ball(10.0, name), **given)


WALL = ball("wall", "reference", [0.0, 0.0, -100.0])
VESSEL = ball("vessel", "needle", [0.0, 80.0, 0.0])
TUMOR_ALONE = SessionSetup(
    TIP, Transform.identity("needle", "tumor"), AnalyticSphere(10.0), PARAMETERS, None
)
SETUP = replace(TUMOR_ALONE, structures=(WALL, VESSEL))


class Run:
    """A session with ``setup`` whose tool is above the tumour; one frame each 20 ms."""

    def __init__(self, setup: SessionSetup) -> None:
        self.session, self._at_ms, self._setup = Session(setup), 0.0, setup

    def step(self, tip_mm=(0.0, 0.0, 40.0), without=()):
        self._at_ms += 20.0
        poses = [
            lost("tracker", name, self._at_ms, TrackingStatus.INVALID)
            if name in without
            else sample("tracker", name, at, self._at_ms)
            for name, at in {
                "needle": (0.0, 0.0, 1e-4 * self._at_ms),
                "reference": (0.0, 0.0, -1e-4 * self._at_ms),
                "cautery": tip_mm,
            }.items()
        ]
        return self.session.step(frame(self._at_ms, *poses))

    def use(self, *structures: Structure) -> bool:
        return self.session.use(replace(self._setup, structures=structures))

    def known(self):
        """The first step after a few that is not on hold by a fault."""
        for _ in range(5):
            step = self.step()
        assert step.decision.state is MarginState.NEGATIVE
        return step


@pytest.fixture
def run() -> Run:
    made = Run(SETUP)
    assert not made.known().decision.hold
    return made


def stop_mm(step, name: str) -> float:
    return next(e.decision.margin.stop_mm for e in step.structures if e.name == name)


@pytest.mark.parametrize(
    ("structures", "text"),
    [
        ((VESSEL,), "structure 'wall' removed"),
        ((), "structure 'wall' removed"),
        ((replace(WALL, proximity=Ball(9.0, "wall")), VESSEL), "structure 'wall': replaced"),
        ((ball("wall", "reference", [0.0, 0.0, -101.0]), VESSEL), "structure 'wall': replaced"),
        ((replace(WALL, stop_mm=1.5), VESSEL), "structure 'wall': stop_mm lowered from 2 to 1.5"),
        (
            (WALL, replace(VESSEL, warn_mm=5.0, sigma_mm=0.1)),
            "structure 'vessel': warn_mm lowered from 6 to 5, sigma_mm lowered from 0.3 to 0.1",
        ),
        (
            (ball("wall", "reference", [0.0, 0.0, -101.0], stop_mm=1.0), VESSEL),
            "structure 'wall': replaced, stop_mm lowered from 2 to 1",
        ),
    ],
)
def test_loosened_structure_latches_the_hold_that_names_it(run, structures, text):
    assert run.use(*structures)
    assert text in run.session.hold_causes
    steps = [run.step() for _ in range(5)]
    assert all(step.decision.hold for step in steps)
    assert all(Reason.LATCHED in step.decision.reasons for step in steps)
    run.session.rearm()
    assert not run.step().decision.hold
    assert run.session.hold_causes == ()


def test_lower_distances_apply_from_the_rearm_on(run):
    run.use(replace(WALL, stop_mm=1.5, warn_mm=7.0), VESSEL)
    step = run.step()
    assert stop_mm(step, "wall") == 2.0
    assert step.structures[1].decision.margin.warn_mm == 7.0  # tightened: at once
    run.session.rearm()
    assert stop_mm(run.step(), "wall") == 1.5


def test_higher_distances_apply_at_once_without_a_hold(run):
    before = run.step().structures[1].decision.margin
    assert not run.use(replace(WALL, stop_mm=3.0, warn_mm=9.0, sigma_mm=0.5), VESSEL)
    step = run.step()
    margin = step.structures[1].decision.margin
    assert (margin.stop_mm, margin.warn_mm) == (3.0, 9.0)
    assert margin.tre_mm > before.tre_mm
    assert not step.decision.hold
    assert step.decision.state is MarginState.NEGATIVE
    assert run.session.hold_causes == ()


def test_added_structure_counts_from_the_next_step_on_without_a_hold(run):
    nerve = ball("nerve", "needle", [0.0, 0.0, 70.0])
    assert not run.use(WALL, VESSEL, nerve)
    step = run.step()
    assert [each.name for each in step.structures] == ["tumor", "wall", "vessel", "nerve"]
    assert step.decision.state is MarginState.NEGATIVE
    assert not step.decision.hold
    assert run.step(tip_mm=(0.0, 0.0, 55.0)).decision.state is MarginState.WARNING
    assert run.use(WALL, VESSEL)
    assert run.session.hold_causes == ("structure 'nerve' removed",)


def test_added_structure_that_the_tool_is_inside_of_stops_it_at_once(run):
    run.use(WALL, VESSEL, ball("nerve", "needle", [0.0, 0.0, 45.0]))
    decision = run.step().decision
    assert decision.state is MarginState.POSITIVE
    assert Reason.INSIDE in decision.reasons


def test_planes_before_a_change_are_not_published_after_it(run):
    run.use(VESSEL)
    step = run.step(without=("cautery",))
    assert step.decision.state is MarginState.UNKNOWN
    assert step.decision.constraint is None
    # The pose is doubted until the re-arm.
    assert not run.step().decision.constraint_is_current


@pytest.mark.parametrize("stop_mm", [6.0, 300.0])
def test_structure_whose_distances_are_no_margins_changes_nothing(run, stop_mm):
    with pytest.raises(MarginParameterError):
        run.use(WALL, replace(VESSEL, stop_mm=stop_mm))
    assert [each.name for each in run.step().structures] == ["tumor", "wall", "vessel"]


def test_half_spaces_of_a_removed_structure_are_not_named_any_more(run):
    assert run.step().half_spaces_of == (0, 1, 2)
    run.use()
    step = run.step()
    assert (step.structures, step.half_spaces_of) == ((), ())
    run.use(WALL)
    step = run.step(without=("cautery",))
    assert (step.decision.constraint, step.half_spaces_of) == (None, ())


def test_lost_structure_makes_the_session_unknown_and_its_planes_not_current(run):
    step = run.step(without=("reference",))
    assert [each.decision.state.name for each in step.structures] == [
        "NEGATIVE",
        "UNKNOWN",
        "NEGATIVE",
    ]
    assert step.decision.state is MarginState.UNKNOWN
    assert step.decision.hold and not step.decision.constraint_is_current
    assert Reason.INVALID in step.decision.reasons and Reason.CLEAR not in step.decision.reasons


def test_forbidden_structure_is_kept_out_of_like_a_target():
    for role in Role:
        setup = replace(TUMOR_ALONE, structures=(replace(WALL, role=role),))
        near, inside = (Run(setup).step(tip_mm=(0.0, 0.0, z)) for z in (-85.0, -95.0))
        assert near.decision.state is MarginState.WARNING
        assert inside.decision.state is MarginState.POSITIVE
        assert Reason.INSIDE in inside.decision.reasons


def test_nearest_structure_governs_in_the_frame_of_the_tumour():
    step = Run(SETUP).step(tip_mm=(0.0, 66.0, 0.0))  # 4 mm from the vessel
    decision = step.decision
    assert decision.proximity.signed_distance_mm == pytest.approx(4.0, abs=1e-3)
    assert decision.state is MarginState.WARNING
    assert decision.constraint.frame == "tumor"
    np.testing.assert_allclose(decision.proximity.on_tool_mm, [0.0, 66.0, 0.0], atol=0.1)
    np.testing.assert_allclose(decision.constraint.normals[0], [0.0, -1.0, 0.0], atol=1e-3)
    assert decision.margin.stop_mm == 2.0


def test_structures_of_one_name_are_refused():
    with refused(text="structures: 2 shapes are named 'wall'", error=FrameError):
        replace(SETUP, structures=(WALL, WALL))


def test_structure_measured_with_another_tool_is_refused():
    other = Ball(10.0, "wall", tool="probe_tip")
    with refused(text="the tool's shape is in 'probe_tip'", error=FrameError):
        replace(SETUP, structures=(replace(WALL, proximity=other),))


def test_ten_structures_around_the_tip_alone_have_eight_planes():
    around = [
        ball(f"b{index}", "needle", [30.0 * np.cos(index), 30.0 * np.sin(index), 100.0])
        for index in range(10)
    ]
    run = Run(replace(TUMOR_ALONE, structures=tuple(around)))
    step = run.step(tip_mm=(0.0, 0.0, 100.0))
    assert step.decision.constraint_is_current
    assert len(step.decision.constraint) == 8


def test_planes_of_each_structure_have_its_own_velocity():
    """The tumour breathes with the needle; the chest wall is at rest in the reference."""
    wall = ball("wall", "reference", [80.0, 0.0, 0.0])
    lesion = ball("lesion", "needle", [3.0, 40.0, 5.0])
    session = Session(replace(make_setup(EXPECTED), structures=(wall, lesion)))
    rng = np.random.default_rng(0)
    steps = [
        session.step(frame(at, *breath(at, rng), joints=joints(at)))
        for at in np.arange(0.0, 3000.0, 20.0)
    ]
    speeds = []
    for step in steps[50:]:
        tumor, of_wall, of_lesion = (
            each.decision.constraint.tumor_velocities_mm_s for each in step.structures
        )
        assert not of_wall.any()
        speeds.append([np.linalg.norm(each[0]) for each in (tumor, of_lesion)])
        joined = step.decision.constraint
        assert step.decision.constraint_is_current
        moving = [row for row in joined.tumor_velocities_mm_s if row.any()]
        assert len(joined) == 3 and len(moving) == 2
        # Both move with the needle; their axes differ.
        np.testing.assert_allclose(moving[0], moving[1], atol=1.5)
    assert max(speeds)[0] > 5.0
    np.testing.assert_allclose(*np.transpose(speeds), atol=1.5)


def test_corridor_narrower_than_the_margins_allows_no_way_across():
    sides = [ball(f"side_{x:g}", "needle", [x, 0.0, 60.0]) for x in (-11.0, 11.0)]
    step = Run(replace(TUMOR_ALONE, structures=tuple(sides))).step(tip_mm=(0.0, 0.0, 60.0))
    constraint = step.decision.constraint
    assert step.decision.state is MarginState.WARNING
    assert step.decision.constraint_is_current
    assert sorted(constraint.normals[:, 0].round(3)) == [-1.0, 0.0, 1.0]
    assert (constraint.clearances_mm < 0.0).sum() == 2
    tip_mm = step.structures[0].structure_from_tip.translation_mm
    for way in ([20.0, 0.0, 0.0], [-20.0, 0.0, 0.0], [0.0, 0.0, -20.0]):
        twist = limit_twist(
            np.array([*way, 0.0, 0.0, 0.0]), constraint, tip_mm, LimiterParameters()
        )
        # Stopped across the corridor, free out of it: the needle is 0.002 mm above the tip.
        np.testing.assert_allclose(twist[:3], [0.0, *way[1:]], atol=0.05)


def test_structure_that_is_off_has_a_line_with_its_name_in_words_and_the_reason():
    assert off_line("chest_wall", "not in the field") == "chest wall: OFF, not in the field"
