"""A planned motion under the fixture's rule: slowed down at planes, stopped for good by faults."""

from dataclasses import replace

import numpy as np
import pytest

from app.control import (
    JointMeasurement,
    Outcome,
    PlanExecution,
    PlannedMotion,
    PoseMeasurement,
    open_control,
    read_plan,
)
from app.fixture import MarginState, PlainConstraint
from app.geometry import InputError, Transform
from app.planning.path_timing import time_path
from tests.tiers import PROJECT_ROOT

pytestmark = pytest.mark.slow

MS = 1_000_000
PERIOD_NS = 5 * MS
DELAY_NS, VALID_NS = 20 * MS, 100 * MS
LAG_S = 0.02
START = np.array([0.0, 1.0, 0.5, 0.0, 0.1, 0.0])
LIMITS = np.array([[1.0], [5.0], [50.0]])
FAR_MM = -1000.0


@pytest.fixture(scope="module")
def description():
    return open_control(PROJECT_ROOT / "data" / "worlds" / "lumpectomy")


@pytest.fixture
def motion(description):
    """The waist turns, the elbow bends and the tip goes down by 60 mm."""
    joints = description.tool.joints
    states = START[[0, 1, 2]] + np.array([[0.0] * 3, [0.3, 0.1, 0.0], [0.3, 0.1, -0.5]])
    held = dict(zip(joints[3:], START[3:].tolist(), strict=True))
    timed = time_path(states, LIMITS * np.ones(3))
    return PlannedMotion("touch", joints[:3], held, *timed, LIMITS[1] * np.ones(3), "setup")


class Loop:
    """The execution, an arm that follows with a lag, and a guard with one horizontal plane."""

    def __init__(self, description, motion, plane_mm=FAR_MM):
        self.execution = PlanExecution(description, motion)
        self.tool, self.plane_mm = description.tool, plane_mm
        self.now_ns, self.steady_ns, self.seq, self.waiting = 0, 0, 0, []
        self.positions = START.copy()
        self.sent, self.clearances_mm = [], []
        self.pose = Transform.identity("tumor", "base")
        self.fields, self.is_paused = {}, False

    def measure(self):
        """The guard sees the arm, and its constraint arrives later."""
        tip = self.tool.evaluate(self.positions)[0].translation_mm
        self.clearances_mm.append(tip[2] - self.plane_mm)
        self.seq += 1
        message = PlainConstraint(
            "guard", self.seq, "tumor", self.now_ns, self.now_ns + VALID_NS,
            int(MarginState.NEGATIVE), False, True, True, np.array([[0.0, 0.0, 1.0]]),
            np.array([self.plane_mm]), np.array([tip]), np.zeros((1, 3)), 1000.0, 1.0, 250.0, 2.0,
            "setup",
        )  # fmt: skip
        if self.fields is not None:
            self.waiting.append(replace(message, **self.fields))
        while self.waiting and self.waiting[0].stamp_ns + DELAY_NS <= self.now_ns:
            self.execution.receive(self.waiting.pop(0), self.now_ns)

    def inputs(self):
        joints = JointMeasurement(self.now_ns, self.tool.joints, tuple(self.positions.tolist()))
        return joints, PoseMeasurement(self.now_ns, self.pose), self.now_ns

    def begin(self):
        for _ in range(20):
            self.now_ns += PERIOD_NS
            self.measure()
        return self.execution.problem(*self.inputs())

    def step(self, change=lambda *inputs: inputs):
        self.now_ns, self.steady_ns = self.now_ns + PERIOD_NS, self.steady_ns + PERIOD_NS
        self.measure()
        step = self.execution.step(
            *change(*self.inputs()), self.steady_ns, is_paused=self.is_paused
        )
        self.sent.append(step.positions)
        share = 1.0 - np.exp(-PERIOD_NS * 1e-9 / LAG_S)
        self.positions += share * (step.positions - self.positions)
        return step

    def run(self, condition=lambda step: step.is_over, change=lambda *inputs: inputs):
        for _ in range(5000):
            step = self.step(change)
            if condition(step):
                return step
        pytest.fail(f"not within 5000 steps: {step}")

    def largest_acceleration(self):
        return np.abs(np.diff(self.sent, n=2, axis=0)).max() / (PERIOD_NS * 1e-9) ** 2


def test_motion_arrives_and_ends(description, motion):
    loop = Loop(description, motion)
    assert loop.begin() == ""
    last = loop.run()
    assert last.outcome is Outcome.ARRIVED
    np.testing.assert_array_equal(last.positions[:3], motion.positions[-1])
    np.testing.assert_allclose(loop.positions, last.positions, atol=1e-3)
    assert loop.largest_acceleration() <= 1.1 * 5.0


def test_plane_in_the_way_slows_the_motion_down_and_is_not_reached(description, motion):
    ends = START.copy(), START.copy()
    ends[1][:3] = motion.positions[-1]
    start, bottom = (description.tool.evaluate(each)[0].translation_mm[2] for each in ends)
    loop = Loop(description, motion, 0.5 * (start + bottom))
    assert loop.begin() == ""
    last = loop.run()
    assert last.outcome is Outcome.BLOCKED
    assert 0.0 < min(loop.clearances_mm) < 0.5
    assert loop.largest_acceleration() <= 1.1 * 5.0


@pytest.mark.parametrize(("progress", "plane_mm"), [(0.2, FAR_MM), (0.6, 105.0)])
def test_hold_stops_before_the_plane_within_the_accelerations(
    description, motion, progress, plane_mm
):
    loop = Loop(description, motion, plane_mm)
    loop.begin()
    loop.run(lambda step: step.progress > progress or np.abs(step.velocities).max() < 1e-3)
    loop.fields = {"hold": True}
    last = loop.run()
    assert last.outcome is Outcome.RULE
    assert last.text == "constraint: hold; expected one that allows motion"
    assert loop.largest_acceleration() <= 1.1 * 5.0
    assert min(loop.clearances_mm) > 0.0
    loop.fields = {}
    still = [loop.step().positions for _ in range(50)]
    assert np.ptp(still, axis=0).max() == 0.0, "a stop is for good"


FAULTS = {
    "guard is silent": (lambda loop: setattr(loop, "fields", None), Outcome.RULE, "expired"),
    "other guard": ({"instance_id": "other"}, Outcome.RULE, "instance_changed"),
    "other setup": ({"setup_id": "other"}, Outcome.OTHER_SETUP, "has the setup 'other'; expected"),
    "repeated seq": ({"seq": 1}, Outcome.RULE, "seq_not_increasing"),
    "other pose": ({"planes_current": False}, Outcome.RULE, "other_pose"),
    "not finite": ({"free_distance_mm": np.nan}, Outcome.RULE, "not_finite"),
    "ended": (lambda loop: loop.execution.end(Outcome.CANCELLED, "x"), Outcome.CANCELLED, "x"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_fault_stops_the_motion_for_good(description, motion, fault):
    change, outcome, text = FAULTS[fault]
    loop = Loop(description, motion)
    assert loop.begin() == ""
    loop.run(lambda step: step.progress > 0.3)
    if callable(change):
        change(loop)
    else:
        loop.fields = change
    last = loop.run()
    assert last.outcome is outcome
    assert text in last.text
    assert last.progress < 0.7
    assert loop.largest_acceleration() <= 1.1 * 5.0


@pytest.mark.parametrize(
    ("change", "outcome"),
    [
        (lambda joints, pose, now_ns: (None, pose, now_ns), Outcome.NO_JOINTS),
        (lambda joints, pose, now_ns: (joints, None, now_ns), Outcome.NO_POSE),
        (
            lambda joints, pose, now_ns: (replace(joints, stamp_ns=now_ns - 31 * MS), pose, now_ns),
            Outcome.NO_JOINTS,
        ),
        (
            lambda joints, pose, now_ns: (
                joints,
                replace(pose, stamp_ns=now_ns - 1000 * MS),
                now_ns,
            ),
            Outcome.NO_POSE,
        ),
        (
            lambda joints, pose, now_ns: (replace(joints, positions=tuple(START)), pose, now_ns),
            Outcome.OFF_PATH,
        ),
        (lambda joints, pose, now_ns: (joints, pose, now_ns - 1000 * MS), Outcome.NO_JOINTS),
    ],
)
def test_unusable_measurement_stops_the_motion(description, motion, change, outcome):
    loop = Loop(description, motion)
    loop.begin()
    loop.run(lambda step: step.progress > 0.3)
    before = loop.execution.step(*loop.inputs(), loop.steady_ns).velocities
    late = loop.step(change)
    assert np.abs(late.velocities).max() < np.abs(before).max(), "it brakes at once"
    last = loop.run(lambda step: step.is_over, change)
    assert last.outcome is outcome
    assert loop.run().outcome is outcome


@pytest.mark.parametrize("jump_ms", [-1000, -6, 50, 1000])
def test_clock_that_is_set_does_not_make_the_arm_jump(description, motion, jump_ms):
    loop = Loop(description, motion)
    loop.begin()
    loop.run(lambda step: step.progress > 0.3)
    loop.now_ns += jump_ms * MS
    assert loop.run().outcome in (Outcome.RULE, Outcome.ARRIVED)
    assert loop.largest_acceleration() <= 1.1 * 5.0


def test_late_measurement_only_slows_the_motion_down(description, motion):
    loop = Loop(description, motion)
    loop.begin()
    loop.run(lambda step: step.progress > 0.3)
    for _ in range(15):
        slower = loop.step(lambda joints, pose, now_ns: (None, None, now_ns))
    assert slower.outcome is None
    assert loop.run().outcome is Outcome.ARRIVED
    assert loop.largest_acceleration() <= 1.1 * 5.0


@pytest.mark.parametrize(
    ("fields", "positions", "problem"),
    [
        ({"hold": True}, START, "constraint: hold; expected one that allows motion"),
        ({"setup_id": "other"}, START, "guard: has the setup 'other'; expected 'setup' of"),
        ({"state": int(MarginState.UNKNOWN)}, START, "constraint: hold; expected"),
        (None, START, "constraint: no_message; expected one that allows motion"),
        ({}, START + 0.003, "joint 'waist': is at 0.0030, the plan begins at 0.0000; expected at"),
    ],
)
def test_motion_does_not_begin(description, motion, fields, positions, problem):
    loop = Loop(description, motion)
    loop.fields, loop.positions = fields, np.array(positions)
    assert problem in loop.begin()


def test_plan_for_something_else_is_refused(description, motion):
    for change, problem in (
        ({"robot": "other"}, "plan: is of robot 'other'; expected 'touch'"),
        ({"held": {}}, "plan: has the joints waist, shoulder, elbow; expected waist, shoulder, e"),
        (
            {"positions": motion.positions + 9.0},
            "joint 'waist' between 9 and 9.3 with up to .* expected -1.3 to 1.3, at most 10",
        ),
        (
            {"accelerations": np.full(3, 5.1)},
            "plan: accelerates joint 'waist' by up to 5.1 per s2; expected at most 5 per s2",
        ),
        ({"setup_id": ""}, "plan: has no setup_id; expected one made with --guard"),
    ):
        with pytest.raises(InputError, match=problem):
            PlanExecution(description, replace(motion, **change))


@pytest.mark.parametrize("text", ["[]", "{", '{"robot": 3}', '{"times_ns": [0.5]}'])
def test_file_that_is_no_plan_is_named(tmp_path, text):
    path = tmp_path / "plan.json"
    path.write_text(text)
    with pytest.raises(InputError, match=r"plan\.json"):
        read_plan(path)


def test_paused_motion_brakes_waits_and_goes_on(description, motion):
    loop = Loop(description, motion)
    assert loop.begin() == ""
    loop.run(lambda step: step.progress > 0.3)
    loop.is_paused = True
    stopped = loop.run(lambda step: not step.velocities.any())
    assert 0.3 < stopped.progress < 0.9
    for _ in range(600):  # 3 s, longer than a motion may be blocked
        waiting = loop.step()
    assert (waiting.progress, waiting.is_over) == (stopped.progress, False)
    loop.is_paused = False
    assert loop.run().outcome is Outcome.ARRIVED
    assert loop.largest_acceleration() <= 1.1 * 5.0
