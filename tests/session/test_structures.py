"""Several structures in one session: each as alone, together the worst, planes for all of them."""

import numpy as np
import pytest
import trimesh

from app.case import TrackingFrame
from app.fixture import (
    Constraint,
    FixtureDecision,
    LimiterParameters,
    MarginState,
    Reason,
    limit_twist,
)
from app.fixture.control.constraint import MAX_PLANES
from app.fixture.proximity.values import FreeMotion
from app.geometry import Stamp, SurfaceMesh, TrackedTransform, Transform
from app.session import Role, Session
from app.session.combined_decision import CombinedDecision
from app.session.structure import StructureStep
from tests.fixture.control.guarded_loop import Guard
from tests.session.structure_worlds import (
    TIP,
    Body,
    check_jumps,
    compare_with_single_sessions,
    judge_planes,
    setup_of,
)
from tests.session.vessel_pushes import LOSS_MM, STOP_MM, push

pytestmark = pytest.mark.slow


@pytest.mark.parametrize(("seed", "structures"), [(0, 1), (2, 3), (4, 9)])
def test_each_structure_is_decided_as_by_a_session_of_its_own(seed, structures):
    compare_with_single_sessions(np.random.default_rng(seed), structures, 150 // structures + 20)


def test_planes_of_all_structures_permit_no_motion_into_one():
    rng = np.random.default_rng(1)
    judged = [judge_planes(rng, motions=40) for _ in range(4)]
    assert sum(each.motions for each in judged) > 50
    assert any(each.left_out for each in judged)


@pytest.mark.parametrize("decimals", [0, 6])  # 0: many planes have equal clearances
def test_nearest_planes_are_kept_and_motion_ends_before_the_others(decimals):
    rng = np.random.default_rng(4)
    ends = set()
    for _ in range(200):
        rows = rng.normal(0.0, 3.0, (rng.integers(2, 5), rng.integers(3, 9), 10)).round(decimals)
        free = FreeMotion(*rng.uniform(0.0, 4.0, 2))
        steps = [step_of(each, free) for each in rows]
        far_mm = rng.uniform(0.0, 8.0)
        combined = CombinedDecision()
        constraint = combined.of(steps, 20.0, far_mm).constraint
        rows, owners = np.concatenate(rows), np.repeat(np.arange(len(rows)), len(rows[0]))
        clearances = np.einsum("ij,ij->i", rows[:, 1:4], rows[:, 4:7]) - rows[:, 0]
        order = [0, *1 + np.argsort(clearances[1:], kind="stable")]
        kept, others = np.sort(order[:MAX_PLANES]), order[MAX_PLANES:]
        np.testing.assert_allclose(constraint.rows, rows[kept], atol=1e-12)
        assert combined.half_spaces_of == tuple(owners[kept])
        left_out_mm = max(min(clearances[others], default=np.inf), 0.0)
        limits_mm = [free.distance_mm, far_mm, left_out_mm]
        assert constraint.free.distance_mm == pytest.approx(min(limits_mm))
        turns_rad = [free.turn_rad, far_mm / 20.0, left_out_mm / 20.0]
        assert constraint.free.turn_rad == pytest.approx(min(turns_rad))
        ends.add(int(np.argmin(limits_mm)))
    assert ends == {0, 1, 2}


def step_of(rows, free):
    """A structure with these planes; the tool is at its origin."""
    decision = FixtureDecision(
        MarginState.NEGATIVE,
        (Reason.CLEAR,),
        *(None, None),
        Constraint.unchecked("tumor", rows, hold=False, free=free),
        hold=False,
        stamp=Stamp(1),
        seq=1,
        constraint_is_current=True,
    )
    tip = Transform.identity("tumor", "tip")
    return StructureStep("tumor", Role.TARGET, decision, tip, None)


def test_hold_and_oldest_pose_of_any_structure_are_those_of_the_session():
    combined, still = CombinedDecision(), step_of(np.ones((2, 10)), FreeMotion(1.0, 1.0))
    for changes in ({"stamp": Stamp(0), "hold": True}, {"stamp": Stamp(0)}):
        other = still._replace(decision=still.decision._replace(**changes))
        decision = combined.of([still, other], 20.0)
        assert decision.stamp == Stamp(0)
        assert decision.hold is decision.constraint.hold is ("hold" in changes)
    unknown = other._replace(decision=other.decision._replace(constraint_is_current=False))
    decision = combined.of([still, unknown], 20.0)
    assert (decision.constraint_is_current, decision.constraint.hold) == (False, True)


def test_jump_of_one_frame_makes_all_structures_unknown():
    assert check_jumps(np.random.default_rng(8), structures=4, frames=150) > 3


def test_tool_does_not_enter_a_vessel_beside_the_tumour(project_root):
    cautery = trimesh.load(project_root / "data" / "recorded_case" / "cautery.stl")
    assert push(6, cautery) >= STOP_MM - LOSS_MM
    assert push(6, cautery, Guard) < 0.0  # knows the tumour alone


def corridor_step(gap_mm, opening_rad=0.0):
    """The tool between two walls, ``gap_mm`` from each, which open along x by the angle."""
    bodies = []
    for name, side in (("s0", 1.0), ("s1", -1.0)):
        box = trimesh.creation.box([80.0, 10.0, 60.0])
        turn = Transform.from_rotation_vector(
            [0.0, 0.0, side * 0.5 * opening_rad],
            [0.0, side * (1.0 + gap_mm + 5.0), 0.0],
            target="reference",
            source=name,
        )
        mesh = SurfaceMesh(name, box.vertices, box.faces)
        bodies.append(Body(mesh, turn, 1.0, 6.0, 0.0, Role.TARGET))
    stamp, session = Stamp(10**9), Session(setup_of(bodies), free_motion=True)
    poses = {"reference": Transform.identity("tracker", "reference")}
    poses["cautery"] = Transform.identity("tracker", "cautery_tip") @ TIP.inverse()
    samples = [TrackedTransform.valid(pose, stamp) for pose in poses.values()]
    return session.step(TrackingFrame(stamp, tuple(samples), ()))


@pytest.mark.parametrize(
    ("gap_mm", "opening_rad", "narrow"),
    [(0.5, 0.0, True), (0.9, 0.0, True), (1.2, 0.0, False), (0.9, 0.5, False)],
)
def test_corridor_narrower_than_tool_and_margins_stops_it_and_says_so(gap_mm, opening_rad, narrow):
    decision = corridor_step(gap_mm, opening_rad).decision
    assert (Reason.NARROW in decision.reasons) is narrow
    assert (decision.state, decision.hold) == (MarginState.WARNING, False)
    if narrow:  # between the walls it is not moved, and can be pulled out
        for side in (20.0, -20.0):
            asked = np.array([0.0, side, -20.0, 0.0, 0.0, 0.0])
            allowed = limit_twist(asked, decision.constraint, np.zeros(3), LimiterParameters())
            assert allowed[:3] == pytest.approx([0.0, 0.0, -20.0], abs=0.1)
