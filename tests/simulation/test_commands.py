"""Commands of each kind: what the arm does, when it stops, and what is refused."""

from dataclasses import replace

import numpy as np
import pytest

from app.geometry import Transform
from app.robot import load_robot
from app.simulation import (
    COMMAND_LIFETIME_NS,
    ArmCommand,
    ArmStatus,
    CommandError,
    JointPositionCommand,
    JointVelocityCommand,
    StateCommand,
    ToolEntry,
    ToolPoseCommand,
    ToolTwistCommand,
    ToolWrenchCommand,
    World,
    WorldState,
    Wrench,
)
from tests.simulation.conftest import PARALLELOGRAMS, arm, box, world_of

pytestmark = pytest.mark.long

BENT = {"shoulder": 1.0, "elbow": 0.5, "pitch": 0.1}
TURNED = Transform.from_rotation_vector((0, 0, 0.7), (10, -20, 30), target="world", source="base")


def tool_of(link: str) -> ToolEntry:
    at = Transform("link", "tool", np.eye(3), np.array([0.0, 0.0, 70.0])).renamed(target=link)
    return ToolEntry("tool", link, box("tool", 4, 4, 4), at, 0.02, 0.3, "none")


@pytest.fixture
def world(touch):
    entry = arm(touch, collision="none", tool=tool_of("stylus"), armature_kg_m2=0.005)
    base = TURNED.renamed(source=touch.root_link)
    return World(world_of(replace(entry, world_from_base=base, positions=BENT)))


def follow(world: World, command: ArmCommand, steps: int = 1) -> WorldState:
    for _ in range(steps):
        state = world.step({"arm": replace(command, stamp_ns=world.time_ns)})
    return state


def base_from_tool(world: World, state: WorldState) -> Transform:
    return world.description.robots[0].world_from_base.inverse() @ state.bodies["tool"]


def moved(pose: Transform, *offset_mm: float) -> Transform:
    place = pose.translation_mm + np.array(offset_mm)
    return Transform(pose.target, pose.source, pose.rotation, place)


def joint_positions(world: World, *offsets: float) -> JointPositionCommand:
    state = world.state().arms["arm"]
    padded = np.array([*offsets, *[0.0] * (len(state.joints) - len(offsets))])
    return JointPositionCommand(0, state.joints, tuple((state.positions + padded).tolist()))


def pose_command(pose: Transform) -> ToolPoseCommand:
    position = tuple(pose.translation_mm.tolist())
    return ToolPoseCommand(0, pose.target, position, tuple(pose.quaternion_xyzw.tolist()))


def test_joint_positions_are_reached(world):
    goal = joint_positions(world, 0.2, -0.1)
    state = follow(world, goal, 300).arms["arm"]
    np.testing.assert_allclose(state.positions, goal.positions, atol=1e-4)
    assert np.abs(state.velocities).max() < 1e-3
    assert state.command is not None


def test_tool_poses_are_reached(world):
    start = base_from_tool(world, world.state())
    turn = Transform.from_rotation_vector((0.1, 0.05, -0.2), (0, 0, 0), target="tool", source="t")
    goal = moved((start @ turn).renamed(source="tool"), 8.0, -5.0, 6.0)
    reached = base_from_tool(world, follow(world, pose_command(goal), 600))
    np.testing.assert_allclose(reached.translation_mm, goal.translation_mm, atol=0.05)
    np.testing.assert_allclose(reached.rotation, goal.rotation, atol=1e-3)


def test_tool_twists_are_followed_along_the_axes_of_the_base(world):
    root = world.description.robots[0].robot.root_link
    command = ToolTwistCommand(0, root, (20.0, 10.0, -15.0), (0.0, 0.0, 0.0))
    before = base_from_tool(world, follow(world, command, 100))
    after = base_from_tool(world, follow(world, command, 100))
    speed = (after.translation_mm - before.translation_mm) / 0.1
    np.testing.assert_allclose(speed, [20.0, 10.0, -15.0], atol=0.5)
    np.testing.assert_allclose(after.rotation, before.rotation, atol=1e-3)


@pytest.mark.parametrize("in_tool", [False, True])
def test_wrench_of_the_drives_balances_that_of_a_hand(world, in_tool):
    entry = world.description.robots[0]
    force = np.array([1.0, -2.0, 0.5])
    start = world.state().bodies["tool"]
    axes = start.rotation if in_tool else entry.world_from_base.rotation
    frame = "tool" if in_tool else entry.robot.root_link
    command = ToolWrenchCommand(0, frame, tuple(force), (0.0, 0.0, 0.0), in_tool)
    for _ in range(100):
        hand = Wrench(-axes @ force, np.zeros(3))
        state = world.step({"arm": replace(command, stamp_ns=world.time_ns)}, {"tool": hand})
    assert np.linalg.norm(state.bodies["tool"].translation_mm - start.translation_mm) < 0.05
    state = follow(world, command, 30)
    way_mm = state.bodies["tool"].translation_mm - start.translation_mm
    assert way_mm @ (axes @ force) > 0.5, "mm N: without the hand it moves along the force"


def test_arm_without_force_floats(world):
    root = world.description.robots[0].robot.root_link
    command = ToolWrenchCommand(0, root, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    start = world.state().bodies["tool"].translation_mm
    state = follow(world, command, 500)
    assert np.linalg.norm(state.bodies["tool"].translation_mm - start) < 0.05, "no weight"
    for _ in range(50):
        hand = {"tool": Wrench(np.array([0.0, 2.0, 0.0]), np.zeros(3))}
        state = world.step({"arm": replace(command, stamp_ns=world.time_ns)}, hand)
    assert state.bodies["tool"].translation_mm[1] - start[1] > 1.0, "the hand moves it"


def test_speed_limits_hold_under_a_wrench(world):
    root = world.description.robots[0].robot.root_link
    push = ToolWrenchCommand(0, root, (0.0, 60.0, 0.0), (0.0, 0.0, 0.0))
    limits = [joint.dynamics.velocity for joint in world.description.robots[0].robot.joints]
    for _ in range(300):
        velocities = follow(world, push).arms["arm"].velocities
        assert np.all(np.abs(velocities) <= 1.2 * np.array(limits))


def every_command(world: World) -> list[ArmCommand]:
    arm_state, root = world.state().arms["arm"], world.description.robots[0].robot.root_link
    pose = base_from_tool(world, world.state())
    return [
        JointVelocityCommand(0, arm_state.joints, (0.3, 0.0, 0.0, 0.0, 0.0, 0.0)),
        joint_positions(world, 0.5),
        pose_command(moved(pose, 30.0, 0.0, 0.0)),
        ToolTwistCommand(0, root, (50.0, 0.0, 0.0), (0.0, 0.0, 0.0)),
        ToolWrenchCommand(0, root, (2.0, 0.0, 0.0), (0.0, 0.0, 0.0)),
        ToolWrenchCommand(0, "tool", (2.0, 0.0, 0.0), (0.0, 0.0, 0.0), in_tool=True),
    ]


@pytest.mark.parametrize("kind", range(6))
def test_each_command_lasts_30_ms(world, kind):
    command = every_command(world)[kind]
    state = follow(world, command, 30)
    assert np.abs(state.arms["arm"].velocities).max() > 0.02
    last_ns = world.time_ns - 1_000_000
    while world.time_ns <= last_ns + COMMAND_LIFETIME_NS:
        assert world.state().arms["arm"].is_busy
        world.step()
    assert not world.state().arms["arm"].is_busy
    for _ in range(40):
        state = world.step()
    assert np.abs(state.arms["arm"].velocities).max() < 1e-3


@pytest.mark.parametrize("kind", range(6))
def test_each_command_stops_with_a_fault_when_the_next_is_not_finite(world, kind):
    command = every_command(world)[kind]
    follow(world, command, 30)
    names = ("velocities", "positions", "position_mm", "linear_mm_s", "force_n", "force_n")
    field = names[kind]
    values = (np.nan, *getattr(command, field)[1:])
    with pytest.raises(CommandError, match=f"{command.topic} of arm 'arm': .* is nan; expected a"):
        follow(world, replace(command, **{field: values}))
    for _ in range(60):
        state = world.step({"arm": replace(command, stamp_ns=world.time_ns)})
    assert state.arms["arm"].status is ArmStatus.FAULT
    assert np.abs(state.arms["arm"].velocities).max() < 1e-3


@pytest.mark.parametrize(
    ("kind", "change", "problem"),
    [
        (2, {"frame": "world"}, "frame_id is 'world'; expected 'touch_base'"),
        (3, {"frame": ""}, "frame_id is ''; expected 'touch_base'"),
        (4, {"frame": "tool"}, "frame_id is 'tool'; expected 'touch_base'"),
        (5, {"frame": "touch_base"}, "frame_id is 'touch_base'; expected 'tool'"),
        (2, {"quaternion": (0.0, 0.0, 0.0, 0.0)}, "norm of the quaternion is 0; expected 1"),
        (2, {"quaternion": (0.0, 0.0, 0.1, 1.0)}, "norm of the quaternion is 1.005; expected 1"),
        (1, {"positions": (0.0,)}, "1 positions; expected 6"),
        (1, {"joints": ("waist",)}, "joints are waist; expected waist, shoulder"),
    ],
)
def test_invalid_command_is_a_fault(world, kind, change, problem):
    with pytest.raises(CommandError, match=problem):
        follow(world, replace(every_command(world)[kind], **change))
    assert problem.split(";")[0] in world.state().arms["arm"].fault


def test_arm_without_a_tool_has_no_tool_to_move(touch):
    world = World(world_of(arm(touch, collision="none")))
    command = ToolTwistCommand(0, touch.root_link, (1.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    with pytest.raises(CommandError, match=r"servo_cv .* holds no tool; expected servo_jv or ser"):
        follow(world, command)


def test_states_change_as_in_crtk(world):
    move = every_command(world)[0]

    def status() -> ArmStatus:
        return world.state().arms["arm"].status

    follow(world, move, 50)
    world.request("arm", StateCommand.PAUSE)
    state = follow(world, move, 60)
    assert (status(), state.arms["arm"].is_busy) == (ArmStatus.PAUSED, False)
    assert np.abs(state.arms["arm"].velocities).max() < 1e-3
    with pytest.raises(CommandError, match="is 'enable' in state PAUSED; expected the state DISAB"):
        world.request("arm", StateCommand.ENABLE)
    world.request("arm", StateCommand.RESUME)
    assert follow(world, move, 50).arms["arm"].velocities[0] > 0.25
    world.request("arm", StateCommand.DISABLE)
    assert np.abs(follow(world, move, 60).arms["arm"].velocities).max() < 1e-3
    assert status() is ArmStatus.DISABLED
    with pytest.raises(CommandError, match="is 'resume' in state DISABLED; expected the state ENA"):
        world.request("arm", StateCommand.RESUME)
    world.fail("arm", "the test says so")
    with pytest.raises(CommandError, match="is 'pause' in state FAULT"):
        world.request("arm", StateCommand.PAUSE)
    world.request("arm", StateCommand.ENABLE)
    assert (status(), world.state().arms["arm"].fault) == (ArmStatus.ENABLED, "")
    assert follow(world, move, 50).arms["arm"].velocities[0] > 0.25


def test_closed_loop_arm_reaches_tool_poses():
    robot = load_robot(PARALLELOGRAMS / "parallelogram.yaml")
    instrument = next(link.name for link in robot.links if "roll" in link.name)
    world = World(world_of(arm(robot, collision="none", tool=tool_of(instrument))))
    start = base_from_tool(world, world.state())
    goal = base_from_tool(world, follow(world, joint_positions(world, 0.1, 0.1), 500))
    assert np.linalg.norm(goal.translation_mm - start.translation_mm) > 3.0
    world.reset()
    reached = base_from_tool(world, follow(world, pose_command(goal), 1000))
    np.testing.assert_allclose(reached.translation_mm, goal.translation_mm, atol=0.3)
