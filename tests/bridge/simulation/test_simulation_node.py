"""Commands of a controller in another process, and what it reads of the simulated world."""

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from std_srvs.srv import Trigger

from tests.bridge.simulation.stepped_world import ROUNDS
from tests.bridge.simulation.stepped_world import simulated as simulated

pytestmark = pytest.mark.slow


def fault_of(seen):
    return next(s["message"] for s in seen["diagnostics"]["status"] if s["hardware_id"] == "arm")


def test_arm_follows_a_controller_and_stands_without_it(simulated):
    # On a busy machine commands come too late for a while, and the arm slows down.
    simulated.round_until(
        lambda seen: (
            seen["measured_js"]["position"][0] > 0.05
            and simulated.arm.velocities[0] == pytest.approx(0.4, abs=0.01)
        ),
        simulated.velocity(0.4),
    )
    for _ in range(60):  # simulated ms without a command: 30 until the arm stops
        simulated.round(steps=1)
    assert np.abs(simulated.arm.velocities).max() < 1e-3
    stopped = simulated.round_until(
        lambda seen: max(map(abs, seen["measured_js"]["velocity"])) < 1e-3
    )
    assert fault_of(stopped) == "ENABLED"
    assert not simulated.arm.is_busy
    assert stopped["setpoint_js"]["velocity"] == [0.0] * 6


def test_published_values_are_those_of_the_world(simulated):
    simulated.round_until(
        lambda seen: seen["measured_js"]["position"][0] > 0.01, simulated.velocity(0.2)
    )
    for _ in range(60):
        simulated.round(steps=1)
    stamp = None
    for _ in range(ROUNDS):  # until the peer has the newest state
        seen = simulated.round(steps=0)
        if seen["measured_js"]["header"]["stamp"] == stamp:
            break
        stamp = seen["measured_js"]["header"]["stamp"]
    state = simulated.world.state()
    robot = simulated.world.description.robots[0]
    links = robot.robot.forward_kinematics(
        dict(zip(seen["measured_js"]["name"], seen["measured_js"]["position"], strict=True))
    )
    tip = links["stylus"] @ robot.tool.link_from_tool
    position = seen["measured_cp"]["pose"]["position"]
    np.testing.assert_allclose(
        [position[axis] for axis in "xyz"], tip.translation_mm / 1000.0, atol=1e-5
    )
    assert seen["measured_cp"]["header"]["frame_id"] == robot.robot.root_link
    truth = seen["truth/tumor"]["transform"]["translation"]
    # The tumour breathes, at most some mm/s: the newest truth is some ms old.
    np.testing.assert_allclose(
        [1000.0 * truth[axis] for axis in "xyz"], state.bodies["tumor"].translation_mm, atol=0.2
    )
    assert seen["truth/tumor"]["header"] == seen["truth/cautery"]["header"]
    assert seen["tracked"]["header"]["frame_id"] == "tracker"
    assert seen["tumor_sensor"]["header"]["frame_id"] == "tracker"


@pytest.mark.parametrize("simulated", [True], indirect=True)
def test_hand_of_the_world_pushes_and_is_measured(simulated):
    seen = simulated.round_until(
        lambda seen: seen["measured_cf"]["wrench"]["force"] != {"x": 0.0, "y": 0.0, "z": 0.0}
    )
    force = seen["measured_cf"]["wrench"]["force"]
    assert math.hypot(*force.values()) <= 10.0 + 1e-9
    assert seen["measured_cf"]["header"]["frame_id"] == "cautery"


INVALID = {
    "velocity of joint 'waist' is nan; expected a finite": {"velocity": [math.nan] + [0.0] * 5},
    "5 velocities; expected 6": {"velocity": [0.1] * 5},
    "joints are elbow; expected waist, shoulder": {"names": ["elbow"], "velocity": [0.1]},
    "ns in the future; expected the past": {"velocity": [0.1] * 6, "ahead_s": 2},
}


def test_invalid_command_is_a_fault_until_the_arm_is_enabled(simulated):
    client = simulated.ros.node.create_client(Trigger, "/arm/enable")
    for problem, command in INVALID.items():
        command = {"names": simulated.joints, **command}
        simulated.round_until(lambda _: bool(simulated.arm.fault), command)
        assert problem in simulated.arm.fault
        simulated.round_until(lambda seen, problem=problem: problem in fault_of(seen))
        for _ in range(20):  # valid commands change nothing
            simulated.round(simulated.velocity(0.3))
        assert problem in simulated.arm.fault
        simulated.round_until(lambda _: bool(np.abs(simulated.arm.velocities).max() < 1e-3))
        assert problem in simulated.arm.fault
        reply = client.call_async(Trigger.Request())
        simulated.round_until(lambda _, reply=reply: reply.done())
        assert reply.result().success
        simulated.round_until(lambda _: simulated.arm.velocities[0] > 0.25, simulated.velocity(0.3))


def test_second_controller_stops_the_arm(simulated):
    simulated.round_until(lambda _: simulated.arm.velocities[0] > 0.1, simulated.velocity(0.2))
    simulated.add_peer()
    simulated.round_until(lambda _: bool(simulated.arm.fault), simulated.velocity(0.2))
    assert simulated.arm.fault == "/arm/servo_jv has 2 publishers; expected 1"
    for _ in range(10):
        simulated.round(simulated.velocity(0.2))
    assert np.abs(simulated.arm.velocities).max() < 1e-3


def tool_pose(simulated):
    """The tool's pose in the arm's root link."""
    world_from_base = simulated.world.description.robots[0].world_from_base
    return world_from_base.inverse() @ simulated.world.state().bodies["cautery"]


def hold(simulated, *offset_mm):
    """A command to the pose that is ``offset_mm`` from the present one."""
    pose = tool_pose(simulated)
    turn = Rotation.from_matrix(pose.rotation).as_quat().tolist()
    place = ((pose.translation_mm + np.array(offset_mm)) / 1000.0).tolist()
    return {"topic": "servo_cp", "frame": pose.target, "values": [*place, *turn]}


def test_one_controller_moves_the_tool_by_poses_velocities_and_forces(simulated):
    pose, root = tool_pose(simulated), tool_pose(simulated).target
    goal = hold(simulated, 0.0, 5.0, 5.0)
    seen = simulated.round_until(
        lambda _: np.abs(tool_pose(simulated).translation_mm - pose.translation_mm)[1:].min() > 4.8,
        goal,
    )
    assert seen["setpoint_cp"]["header"]["frame_id"] == root
    before = tool_pose(simulated).translation_mm[1]
    simulated.round_until(
        lambda _: tool_pose(simulated).translation_mm[1] < before - 5.0,
        {"topic": "servo_cv", "frame": root, "values": [0.0, -0.03, 0.0]},
    )
    before = tool_pose(simulated).translation_mm[1]
    simulated.round_until(
        lambda _: tool_pose(simulated).translation_mm[1] > before + 2.0,
        {"topic": "servo_cf", "frame": root, "values": [0.0, 1.5, 0.0]},
    )
    goal = [0.0, 1.0, 0.5, 0.0, 0.1, 0.0]
    seen = simulated.round_until(
        lambda _: np.abs(simulated.arm.positions - goal).max() < 0.01,
        {"topic": "servo_jp", "names": simulated.joints, "position": goal},
    )
    assert simulated.arm.fault == ""
    assert seen["setpoint_js"]["position"] in ([], goal)


INVALID_OF_TOOL = {
    "frame_id is 'world'; expected 'touch_base'": {
        "topic": "servo_cp",
        "frame": "world",
        "values": [0.0] * 6 + [1.0],
    },
    "position 'x' is nan; expected a finite number": {
        "topic": "servo_cp",
        "frame": "touch_base",
        "values": [math.nan] * 6 + [1.0],
    },
    "frame_id is 'touch_base'; expected 'cautery'": {
        "topic": "body/servo_cf",
        "frame": "touch_base",
        "values": [1.0, 0.0, 0.0],
    },
}


def test_invalid_tool_command_is_a_fault(simulated):
    client = simulated.ros.node.create_client(Trigger, "/arm/enable")
    for problem, command in INVALID_OF_TOOL.items():
        simulated.round_until(lambda _: simulated.arm.velocities[0] > 0.1, simulated.velocity(0.2))
        simulated.round_until(lambda _: bool(simulated.arm.fault), command)
        assert simulated.arm.fault == problem
        seen = simulated.round_until(lambda seen: seen["operating_state"]["state"] == "FAULT")
        assert not seen["operating_state"]["is_busy"]
        simulated.round_until(lambda _: bool(np.abs(simulated.arm.velocities).max() < 1e-3))
        reply = client.call_async(Trigger.Request())
        simulated.round_until(lambda _, reply=reply: reply.done())


@pytest.mark.parametrize("topic", ["move_jp", "servo_jf"])
def test_sender_of_another_kind_of_motion_is_a_second_controller(simulated, topic):
    simulated.round_until(lambda _: simulated.arm.velocities[0] > 0.1, simulated.velocity(0.2))
    other = simulated.add_peer(idle=True)
    command = {"topic": topic, "names": simulated.joints, "position": [0.0] * 6}
    simulated.round(command, peer=other)
    simulated.round_until(lambda _: bool(simulated.arm.fault), simulated.velocity(0.2))
    assert f"/arm/servo_jv and /arm/{topic} have 2 senders (" in simulated.arm.fault


def test_state_commands_pause_and_resume(simulated):
    def command(text):
        return {"topic": "state_command", "values": text}

    def state_is(name):
        return lambda seen: seen.get("operating_state", {}).get("state") == name

    seen = simulated.round_until(state_is("ENABLED"))
    assert seen["operating_state"]["is_homed"]
    simulated.round_until(lambda _: simulated.arm.velocities[0] > 0.1, simulated.velocity(0.2))
    simulated.round_until(state_is("PAUSED"), command("pause"))
    for _ in range(20):
        simulated.round(simulated.velocity(0.3))
    assert np.abs(simulated.arm.velocities).max() < 1e-3
    simulated.round(command("dance"))
    simulated.round_until(state_is("ENABLED"), command("resume"))
    simulated.round_until(lambda _: simulated.arm.velocities[0] > 0.1, simulated.velocity(0.2))
    assert simulated.arm.fault == ""
