"""The cooperative controller: what it sends for a push, and when it stops."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from app.control import (
    AdmittanceGains,
    ControllerParameters,
    ControlReason,
    CooperativeController,
    JointMeasurement,
    PoseMeasurement,
    ToolKinematics,
    WrenchMeasurement,
)
from app.fixture import FixtureRule, LimiterParameters, MarginState, PlainConstraint, RuleReason
from app.geometry import FrameError, InputError, Transform
from app.robot import Robot, load_robot

ROOT = Path(__file__).resolve().parents[2]
MS = 1_000_000
START = {"shoulder": 1.0, "elbow": 0.5, "pitch": 0.1}
PARAMETERS = ControllerParameters(gains=AdmittanceGains(dead_n=0.0, response_s=0.0))


@pytest.fixture(scope="module")
def touch():
    return load_robot(ROOT / "data" / "robots" / "touch" / "touch.urdf")


@pytest.fixture
def tool(touch):
    mount = Transform("stylus", "cautery", np.eye(3), np.array([0.0, 0.0, 70.0]))
    return ToolKinematics(touch, mount)


@pytest.fixture
def controller(tool):
    rule = FixtureRule(accept_simulated=True, parameters=LimiterParameters(lever_mm=200.0))
    return CooperativeController(tool, rule, PARAMETERS)


POSITIONS = tuple(START.get(n, 0.0) for n in ("waist", "shoulder", "elbow", "yaw", "pitch", "roll"))
JOINTS = JointMeasurement(0, ("waist", "shoulder", "elbow", "yaw", "pitch", "roll"), POSITIONS)
POSE = PoseMeasurement(0, Transform.identity("tumor", "touch_base"))
DOWN = WrenchMeasurement(0, np.array([0.0, 0.0, -10.0]), np.zeros(3), in_tool=False)


def plane(seq: int, now_ns: int, height_mm: float, point: np.ndarray) -> PlainConstraint:
    """The tip must stay above a height in the frame of the tumour."""
    arrays = np.array([[0.0, 0.0, 1.0]]), np.array([height_mm]), np.array([point]), np.zeros((1, 3))
    valid = ("guard", seq, "tumor", now_ns, now_ns + 50 * MS, int(MarginState.NEGATIVE))
    return PlainConstraint(*valid, False, True, True, *arrays, 1000.0, 1.0, 250.0, 2.0, "setup")


def tip_and_jacobian(tool: ToolKinematics) -> tuple[np.ndarray, np.ndarray]:
    pose, jacobian = tool.evaluate(np.array(POSITIONS))
    return pose.translation_mm, jacobian


def stepped(controller: CooperativeController, now_ns: int = 0, **changes: object):
    """A step with fresh measurements, twice, because the first one starts the admittance."""
    inputs = {
        "joints": replace(JOINTS, stamp_ns=now_ns),
        "wrench": replace(DOWN, stamp_ns=now_ns),
        "pose": replace(POSE, stamp_ns=now_ns),
        **changes,
    }
    controller.step(**inputs, now_ns=now_ns)
    return controller.step(**inputs, now_ns=now_ns)


def test_push_in_free_space_moves_the_tip_by_the_admittance(controller, tool):
    tip, jacobian = tip_and_jacobian(tool)
    controller.receive(plane(1, 0, tip[2] - 100.0, tip), 0)
    decision = stepped(controller)
    assert decision.reason is ControlReason.FOLLOWS
    assert decision.desired == pytest.approx([0, 0, -100, 0, 0, 0])
    assert jacobian[:3] @ decision.velocities == pytest.approx([0, 0, -100], abs=3.0)


def test_plane_limits_the_approach_and_not_the_retreat(controller, tool):
    tip, jacobian = tip_and_jacobian(tool)
    controller.receive(plane(1, 0, tip[2] - 1.0, tip), 0)
    approach = jacobian[:3] @ stepped(controller).velocities
    assert approach[2] == pytest.approx(-1.0 / 0.05, abs=1e-3)
    up = replace(DOWN, force_n=-DOWN.force_n)
    retreat = jacobian[:3] @ stepped(controller, wrench=up).velocities
    assert retreat[2] > 90.0


def test_wrench_in_the_tools_axes_is_turned(controller, tool):
    tip, _ = tip_and_jacobian(tool)
    pose, _ = tool.evaluate(np.array(POSITIONS))
    controller.receive(plane(1, 0, tip[2] - 100.0, tip), 0)
    wrench = WrenchMeasurement(0, np.array([1.0, 2.0, 3.0]), np.zeros(3))
    desired = stepped(controller, wrench=wrench).desired[:3]
    assert desired == pytest.approx(10.0 * pose.rotate([1.0, 2.0, 3.0]))


def test_twist_is_limited_in_the_frame_of_the_constraint(controller, tool):
    tip, jacobian = tip_and_jacobian(tool)
    turn = Transform.from_rotation_vector(
        (0.0, np.pi / 2.0, 0.0), (5.0, 6.0, 7.0), target="tumor", source="touch_base"
    )
    point = turn.apply(tip)
    controller.receive(plane(1, 0, point[2] - 1.0, point), 0)
    push = replace(DOWN, force_n=turn.inverse().rotate([0.0, 0.0, -10.0]))
    decision = stepped(controller, wrench=push, pose=PoseMeasurement(0, turn))
    assert turn.rotate(jacobian[:3] @ decision.velocities)[2] == pytest.approx(-20.0, abs=1e-3)


NAN = float("nan")
NO_JOINTS, NO_WRENCH = ControlReason.NO_JOINTS, ControlReason.NO_WRENCH
MISSING = {
    "no joints": ({"joints": None}, NO_JOINTS),
    "old joints": ({"joints": replace(JOINTS, stamp_ns=-31 * MS)}, NO_JOINTS),
    "joints from the future": ({"joints": replace(JOINTS, stamp_ns=1)}, NO_JOINTS),
    "other joints": ({"joints": replace(JOINTS, names=("a", *JOINTS.names[1:]))}, NO_JOINTS),
    "joint twice": ({"joints": replace(JOINTS, names=("waist", *JOINTS.names[:5]))}, NO_JOINTS),
    "joint is NaN": ({"joints": replace(JOINTS, positions=(NAN, *POSITIONS[1:]))}, NO_JOINTS),
    "no wrench": ({"wrench": None}, NO_WRENCH),
    "old wrench": ({"wrench": replace(DOWN, stamp_ns=-31 * MS)}, NO_WRENCH),
    "wrench is NaN": ({"wrench": replace(DOWN, force_n=np.array([0, 0, NAN]))}, NO_WRENCH),
    "no pose": ({"pose": None}, ControlReason.NO_POSE),
    "old pose": ({"pose": replace(POSE, stamp_ns=-101 * MS)}, ControlReason.NO_POSE),
}


@pytest.mark.parametrize("case", MISSING)
def test_measurement_that_is_missing_stops_the_arm(controller, tool, case):
    changes, reason = MISSING[case]
    tip, _ = tip_and_jacobian(tool)
    controller.receive(plane(1, 0, tip[2] - 100.0, tip), 0)
    assert np.abs(stepped(controller).velocities).max() > 0.1
    decision = stepped(controller, **changes)
    assert decision.reason is reason
    assert not decision.velocities.any()


def test_no_constraint_for_30_ms_is_latched_until_rearm(controller, tool):
    tip, _ = tip_and_jacobian(tool)
    assert stepped(controller).reason is ControlReason.RULE
    assert not controller.latched, "nothing has been valid yet"
    controller.receive(plane(1, 0, tip[2] - 100.0, tip), 0)
    now_ns = 0
    while stepped(controller, now_ns).reason is ControlReason.FOLLOWS:
        now_ns += MS
    assert now_ns == 50 * MS, "the constraint has expired"
    while not controller.latched:
        decision = stepped(controller, now_ns)
        assert not decision.velocities.any()
        now_ns += MS
    # Last valid at 49 ms.
    assert now_ns - MS == 80 * MS
    controller.receive(plane(2, now_ns, tip[2] - 100.0, tip), now_ns)
    decision = stepped(controller, now_ns)
    assert decision.reason is ControlReason.WATCHDOG
    assert not decision.velocities.any()
    controller.rearm()
    controller.receive(plane(3, now_ns, tip[2] - 100.0, tip), now_ns)
    assert stepped(controller, now_ns).reason is ControlReason.FOLLOWS


def test_jump_back_of_the_clock_is_latched(controller, tool):
    """It hides how long no constraint has come."""
    tip, _ = tip_and_jacobian(tool)
    controller.receive(plane(1, 0, tip[2] - 100.0, tip), 0)
    assert stepped(controller).reason is ControlReason.FOLLOWS
    assert stepped(controller, -2500 * MS).reason is ControlReason.WATCHDOG
    assert controller.latched


def test_rules_reason_is_reported(controller):
    decision = stepped(controller)
    assert (decision.reason, decision.rule) == (ControlReason.RULE, RuleReason.NO_MESSAGE)


def test_joint_without_a_speed_limit_needs_one(touch):
    joints = tuple(
        replace(j, dynamics=replace(j.dynamics, velocity=None)) if j.name == "elbow" else j
        for j in touch.joints
    )
    robot = Robot(touch.name, touch.links, joints)
    tool = ToolKinematics(robot, Transform.identity("stylus", "cautery"))
    with pytest.raises(
        InputError, match=r"joint 'elbow' has the speed limit None; expected one ab"
    ):
        tool.limits()
    assert tool.limits(0.5).max_speed.tolist() == [10.0, 10.0, 0.5, 20.0, 20.0, 20.0]


def test_tool_on_an_unknown_link_is_refused(touch):
    with pytest.raises(FrameError, match=r"held by 'hand'; expected one of touch_base, torso"):
        ToolKinematics(touch, Transform.identity("hand", "cautery"))


@pytest.mark.parametrize("name", ["max_joints_age_ns", "watchdog_ns"])
def test_ages_must_be_above_0(name):
    with pytest.raises(InputError, match=rf"{name} of the controller is 0; expected more than 0"):
        ControllerParameters(**{name: 0})


def test_jacobian_is_the_derivative_of_the_pose(tool):
    _, jacobian = tool.evaluate(np.array(POSITIONS))
    for column in range(6):
        step = np.zeros(6)
        step[column] = 1e-6
        (ahead, _), (behind, _) = (tool.evaluate(np.array(POSITIONS) + s) for s in (step, -step))
        speed = (ahead.translation_mm - behind.translation_mm) / 2e-6
        back = behind.inverse().renamed(target="cautery", source="touch_base")
        turn = (ahead @ back).rotation_vector / 2e-6
        assert jacobian[:3, column] == pytest.approx(speed, abs=1e-4)
        assert jacobian[3:, column] == pytest.approx(turn, abs=1e-6)


def test_jacobian_of_a_closed_loop_is_the_derivative_of_the_pose():
    robot = load_robot(ROOT / "data" / "robots" / "parallelogram" / "parallelogram.yaml")
    link = next(each.name for each in robot.links if "roll" in each.name)
    names = robot.actuated_joint_names
    at = dict.fromkeys(names, 0.1)
    pose, jacobian = robot.jacobian(link, at)
    assert pose.translation_mm == pytest.approx(robot.forward_kinematics(at)[link].translation_mm)
    for column, name in enumerate(names):
        ahead, behind = (
            robot.forward_kinematics({**at, name: 0.1 + s})[link].translation_mm
            for s in (1e-6, -1e-6)
        )
        assert jacobian[:3, column] == pytest.approx((ahead - behind) / 2e-6, abs=1e-3)


def test_admittance_follows_with_its_response_time_beyond_the_dead_band(tool):
    gains = AdmittanceGains(linear_mm_s_n=10.0, dead_n=1.0, response_s=0.1)
    rule, parameters = FixtureRule(accept_simulated=True), ControllerParameters(gains=gains)
    controller = CooperativeController(tool, rule, parameters)
    tip, _ = tip_and_jacobian(tool)
    for step in range(101):
        now_ns = step * MS
        if step % 20 == 0:
            controller.receive(plane(step + 1, now_ns, tip[2] - 100.0, tip), now_ns)
        measured = (replace(each, stamp_ns=now_ns) for each in (JOINTS, DOWN, POSE))
        decision = controller.step(*measured, now_ns)
    assert decision.desired[2] == pytest.approx(-90.0 * (1.0 - np.exp(-1.0)), rel=1e-6)
