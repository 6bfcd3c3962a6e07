"""Distance between tools: exact, a warning, and no part of the decision on the structures."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from app.case import TrackingFrame
from app.fixture import MarginState, ProximityEngine, Reason
from app.geometry import (
    NS_PER_MS,
    FrameError,
    Stamp,
    SurfaceMesh,
    TrackedTransform,
    TrackingStatus,
    Transform,
)
from app.session import Session
from app.session.far_structures import BEYOND_MM
from app.session.setup import OtherTool
from tests.session.structure_worlds import (
    FIELD_NODES,
    FRAMES,
    TIP,
    TOOL,
    assert_same_decision,
    random_bodies,
    setup_of,
)
from tests.session.tool_worlds import (
    WARN_MM,
    assert_same_distance,
    box,
    compare_with_single_pairs,
    other_tool,
)

pytestmark = pytest.mark.slow


@pytest.mark.parametrize(("seed", "structures", "tools"), [(0, 1, 1), (2, 3, 3)])
def test_other_tools_change_no_decision_and_are_measured_exactly(seed, structures, tools):
    known, unknown = compare_with_single_pairs(
        np.random.default_rng(seed), structures, tools, 60 // tools
    )
    assert min(known, unknown) > 5


NOW = Stamp(10**10)


class Pair:
    """A session of a tumour far away and one other tool, in the tracker's frame."""

    def __init__(self, mesh=None, *, skip_far=False):
        self.tool = other_tool(box() if mesh is None else mesh)
        setup = setup_of(random_bodies(np.random.default_rng(4), 1))
        self.session = Session(replace(setup, other_tools=(self.tool,)), skip_far=skip_far)
        self.now = NOW

    def step(
        self,
        gap_mm=20.0,
        *,
        other=True,
        shake_mm=True,
        status=TrackingStatus.OK,
        tracker="tracker",
        also=(),
        turn_rad=0.0,
    ):
        """The tool's tip, with a side of 3 mm, beside a box of 6 mm, ``gap_mm`` apart along x.

        ``tracker`` measures the box, ``also`` are further poses. The tool is turned about y at its
        tip.
        """
        self.now = self.now.shifted(20 * NS_PER_MS, self.now.clock)
        shake = np.array([0.0, 0.0, 1e-3 * (self.now.ns // (20 * NS_PER_MS) % 7) * shake_mm])
        tip = Transform.from_rotation_vector(
            (0.0, turn_rad, 0.0), shake, target="tracker", source="cautery_tip"
        )
        poses = {
            "cautery": tip @ TIP.inverse(),
            **{name: Transform("tracker", name, np.eye(3), shake) for name in FRAMES},
        }
        samples = [TrackedTransform.valid(pose, self.now) for pose in (*poses.values(), *also)]
        if other:
            place = Transform(
                tracker, "arm1_tip", np.eye(3), [1.5 + 3.0 + gap_mm, 0.0, -12.0 + shake[2]]
            )
            pose = place @ self.tool.tool_from_tip.inverse()
            sample = TrackedTransform.valid(pose, self.now)
            if status is not TrackingStatus.OK:
                sample = TrackedTransform.lost("tracker", "arm1", self.now, status)
            samples.append(sample)
        return self.session.step(TrackingFrame(self.now, tuple(samples), ()))


@pytest.mark.parametrize(
    ("gap_mm", "text", "state"),
    [
        (20.0, "tool 'arm1' is 20.0 mm away", MarginState.NEGATIVE),
        (8.1, "tool 'arm1' is 8.1 mm away", MarginState.NEGATIVE),
        (7.99, "tool 'arm1' is 8.0 mm away", MarginState.WARNING),
        (3.2, "tool 'arm1' is 3.2 mm away", MarginState.WARNING),
        (-2.0, "tool 'arm1' overlaps by 2.0 mm", MarginState.WARNING),
    ],
)
def test_near_tool_is_a_warning_that_changes_no_state(gap_mm, text, state):
    step = Pair().step(gap_mm)
    (tool,) = step.tools
    assert (tool.text, tool.state) == (text, state)
    assert step.warnings == ((text,) if state is MarginState.WARNING else ())
    assert_same_decision(step.decision, Pair().step(100.0).decision)


def test_tool_inside_the_other_has_its_depth():
    (tool,) = Pair(box(sides_mm=(40.0, 40.0, 60.0))).step(gap_mm=-4.5).tools
    assert tool.text == "tool 'arm1' overlaps by 19.0 mm"
    assert tool.state is MarginState.WARNING


@pytest.mark.parametrize(
    ("fault", "reason"),
    [({"other": False}, "missing"), ({"status": TrackingStatus.OUT_OF_VIEW}, "missing")],
)
def test_lost_tool_is_not_known_and_holds_nothing(fault, reason):
    pair, without = Pair(), Pair()
    for _ in range(3):
        assert pair.step().warnings == ()
        without.step()
    for _ in range(20):  # the sample before is soon stale
        step, expected = pair.step(**fault), without.step()
        assert_same_decision(step.decision, expected.decision)
    reason = "stale" if "other" in fault else reason
    assert step.warnings == (f"distance of tool 'arm1' is not known ({reason})",)
    assert pair.step().warnings == ()


def test_tool_that_was_never_tracked_is_not_known():
    assert Pair().step(other=False).warnings == ("distance of tool 'arm1' is not known (missing)",)


def test_tool_whose_poses_repeat_from_the_first_is_not_known():
    pair = Pair()
    for _ in range(200):
        step = pair.step(shake_mm=False)
    assert step.tools[0].state is MarginState.UNKNOWN
    assert Reason.FROZEN in step.tools[0].reasons


def test_reference_of_the_other_tracker_that_is_stuck_makes_the_distance_unknown():
    pair, stuck = Pair(), Transform("second", "reference", np.eye(3), np.zeros(3))
    for _ in range(200):
        step = pair.step(tracker="second", also=[stuck])
    assert step.tools[0].reasons == (Reason.FROZEN,)


@pytest.mark.parametrize("moving", [(), ("arm1",)])
def test_stuck_poses_are_frozen_at_once_beside_another_tool_that_moves(moving):
    setup = setup_of(random_bodies(np.random.default_rng(4), 1))
    session = Session(replace(setup, shown_frames=("arm1",)))
    now, rng = Stamp(10**10), np.random.default_rng(1)
    still = {name: np.zeros(3) for name in (*FRAMES, "cautery")}
    for number in range(60):
        now = now.shifted(20 * NS_PER_MS, now.clock)
        if number < 40:
            still = {name: rng.normal(0.0, 0.02, 3) for name in still}
        places = still | {name: rng.normal(200.0, 0.02, 3) for name in moving}
        poses = [Transform("tracker", name, np.eye(3), place) for name, place in places.items()]
        samples = tuple(TrackedTransform.valid(pose, now) for pose in poses)
        step = session.step(TrackingFrame(now, samples, ()))
        if number == 39:
            assert step.decision.state is not MarginState.UNKNOWN
    assert Reason.FROZEN in step.decision.reasons


def test_fault_outside_the_frames_makes_the_distance_unknown():
    pair = Pair()
    pair.step()
    frame = TrackingFrame(pair.now.shifted(NS_PER_MS, pair.now.clock), (), ())
    step = pair.session.step(frame, {Reason.SECOND_SENDER: "two senders of cautery"})
    assert step.warnings == ("distance of tool 'arm1' is not known (second_sender)",)


def test_far_tool_is_not_measured_and_not_nearer_than_stated():
    measuring, skipping = Pair(), Pair(skip_far=True)
    gaps_mm = [*np.arange(120.0, 0.0, -1.5), *np.arange(0.0, 120.0, 1.5)]
    skipped = 0
    for gap_mm in gaps_mm:
        (exact,), (found,) = measuring.step(gap_mm).tools, skipping.step(gap_mm).tools
        assert found.state is exact.state
        if found.at_least_mm is None:
            assert_same_distance(found, exact)
        else:
            skipped += 1
            assert WARN_MM + BEYOND_MM < found.at_least_mm <= gap_mm + 1e-3
            assert found.text == f"tool 'arm1' is at least {int(found.at_least_mm)} mm away"
    assert skipped > 20


def test_far_tool_is_not_nearer_than_stated_when_the_guarded_one_turns():
    measuring, skipping = Pair(), Pair(skip_far=True)
    skipped = []
    for turn_rad in np.linspace(0.0, 2.0 * np.pi, 200):
        exact, found = (
            pair.step(WARN_MM + BEYOND_MM + 20.0, turn_rad=turn_rad).tools[0]
            for pair in (measuring, skipping)
        )
        if found.at_least_mm is not None:
            skipped.append(exact.proximity.signed_distance_mm)
            assert found.at_least_mm <= skipped[-1]
    assert max(skipped) - min(skipped) > 5.0


def test_each_of_two_guards_warns_of_the_other_tool():
    pair = Pair()
    (tool,) = pair.step(gap_mm=5.0).tools
    engine = ProximityEngine(TOOL, box(), field_nodes=FIELD_NODES)
    turned = OtherTool("cautery", TIP, engine, WARN_MM)
    frame_from_tumor = pair.session.setup.frame_from_tumor
    tumor = trimesh.creation.icosphere(1, radius=3.0)
    setup = replace(
        pair.session.setup,
        tool_from_tip=pair.tool.tool_from_tip,
        proximity=ProximityEngine(
            SurfaceMesh(frame_from_tumor.source, tumor.vertices, tumor.faces), box()
        ),
        other_tools=(turned,),
    )
    pair.session = Session(setup)
    (back,) = pair.step(gap_mm=5.0).tools
    assert (tool.text, back.text) == ("tool 'arm1' is 5.0 mm away", "tool 'cautery' is 5.0 mm away")
    assert tool.state is back.state is MarginState.WARNING


def test_other_tip_of_the_guarded_tool_moves_the_distance():
    pair = Pair(skip_far=True)
    pair.step(gap_mm=100.0)
    tip = Transform("cautery", "cautery_tip", np.eye(3), [94.0, 0.0, 70.0])
    pair.session.use(replace(pair.session.setup, tool_from_tip=tip))
    assert pair.step(gap_mm=100.0).tools[0].text == "tool 'arm1' is 6.0 mm away"


def test_shape_in_another_frame_is_refused():
    tool = other_tool(box())
    wrong = replace(tool, tool_from_tip=Transform.identity("arm1", "knife_tip"))
    setup = setup_of(random_bodies(np.random.default_rng(4), 1))
    with pytest.raises(FrameError, match="the tool 'arm1''s shape is in 'arm1_tip'; expected"):
        replace(setup, other_tools=(wrong,))
    with pytest.raises(FrameError, match="2 shapes are named 'arm1_tip'"):
        replace(setup, other_tools=(tool, tool))
