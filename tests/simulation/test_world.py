"""Stepping a world: arms follow fresh commands, stop without one, and nothing depends on chance."""

from dataclasses import replace

import numpy as np
import pytest

from app.simulation import (
    COMMAND_LIFETIME_NS,
    ArmStatus,
    BodyEntry,
    CommandError,
    JointVelocityCommand,
    ScriptedHand,
    UnstableError,
    World,
    WorldDescription,
    WorldError,
    WorldState,
    Wrench,
    open_world,
)
from tests.simulation.conftest import LUMPECTOMY, arm, box, floor, free_box, placed, world_of

pytestmark = pytest.mark.slow

STEP_NS = 1_000_000


def command(world: World, *velocities: float, age_ns: int = 0) -> JointVelocityCommand:
    joints = world.state().arms["arm"].joints
    padded = (*velocities, *(0.0,) * (len(joints) - len(velocities)))
    return JointVelocityCommand(world.time_ns - age_ns, joints, padded)


def run(world: World, steps: int, *velocities: float) -> WorldState:
    for _ in range(steps):
        state = world.step({"arm": command(world, *velocities)})
    return state


@pytest.fixture
def world(touch):
    return World(world_of(arm(touch, collision="none")))


def test_arm_follows_the_velocities(world):
    state = run(world, 200, 0.4, -0.2)
    assert state.time_ns == 200 * STEP_NS
    arm_state = state.arms["arm"]
    assert arm_state.status is ArmStatus.ENABLED
    assert np.allclose(arm_state.velocities[:2], [0.4, -0.2], atol=1e-3)
    assert np.allclose(arm_state.positions[:2], [0.08, -0.04], atol=3e-3)


def test_arm_stops_when_its_last_command_is_too_old(world):
    run(world, 100, 0.5)
    last_ns = world.time_ns - STEP_NS
    while world.time_ns - last_ns <= COMMAND_LIFETIME_NS:
        state = world.step()
        is_old = state.time_ns - last_ns > COMMAND_LIFETIME_NS
        assert is_old or state.arms["arm"].velocities[0] > 0.4
    assert not state.arms["arm"].is_busy
    assert state.arms["arm"].status is ArmStatus.ENABLED
    for _ in range(30):
        state = world.step()
    tip = np.abs(state.arms["arm"].velocities).max() * 300.0
    assert tip < 1.0, "mm/s at 300 mm from the axis"
    assert run(world, 50, 0.5).arms["arm"].is_busy


def test_command_that_arrives_too_old_moves_nothing(world):
    for _ in range(50):
        world.step({"arm": command(world, 0.5, age_ns=COMMAND_LIFETIME_NS + 1)})
    assert np.abs(world.state().arms["arm"].velocities).max() < 1e-3


def test_older_command_does_not_replace_a_newer_one(world):
    world.step({"arm": command(world, 0.5)})
    world.step({"arm": command(world, -0.5, age_ns=5 * STEP_NS)})
    for _ in range(20):
        state = world.step()
    assert state.arms["arm"].velocities[0] > 0.4


SWAPPED = ("shoulder", "waist", "elbow", "yaw", "pitch", "roll")


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        ({"velocities": (np.nan, 0, 0, 0, 0, 0)}, "velocity of joint 'waist' is nan; expected a f"),
        ({"velocities": (np.inf, 0, 0, 0, 0, 0)}, "velocity of joint 'waist' is inf; expected a f"),
        ({"velocities": (0.1,)}, "1 velocities; expected 6"),
        ({"joints": SWAPPED}, "joints are shoulder, waist, .*; expected waist, shoulder, .* in"),
        ({"joints": ()}, "joints are none; expected waist"),
        ({"stamp_ns": 10**12}, "stamp is .* ns in the future; expected the past"),
    ],
)
def test_invalid_command_is_refused_and_stops_the_arm(world, change, problem):
    run(world, 50, 0.5)
    before = world.time_ns
    with pytest.raises(CommandError, match=problem):
        world.step({"arm": replace(command(world, 0.5), **change)})
    assert world.time_ns == before
    state = run(world, 60, 0.5)
    assert state.arms["arm"].status is ArmStatus.FAULT
    assert np.abs(state.arms["arm"].velocities).max() < 1e-3
    assert state.arms["arm"].fault
    world.enable("arm")
    assert run(world, 60, 0.5).arms["arm"].velocities[0] > 0.4


def test_speed_and_joint_limits_hold(world):
    fastest = max(abs(float(run(world, 1, 99.0).arms["arm"].velocities[0])) for _ in range(400))
    assert 5.0 < fastest <= 10.0 + 1e-6
    assert run(world, 600, 99.0).arms["arm"].positions[0] <= 1.3 + 1e-3


def test_effort_limits_hold_and_a_blocked_arm_gives_way(world, touch):
    before = world.state().arms["arm"].positions[0]
    limits = [joint.dynamics.effort for joint in touch.joints]
    names = {"stylus": Wrench(np.array([0.0, 0.0, 0.0]), np.array([0.0, 0.0, 40.0]))}
    with pytest.raises(WorldError, match=r"wrench on 'stylus': no such body; expected one of none"):
        world.step({}, names)
    world.data.xfrc_applied[world.model.body("arm/torso").id][5] = 40.0
    for _ in range(100):
        state = world.step()
    assert np.all(np.abs(state.arms["arm"].efforts) <= np.array(limits) + 1e-12)
    assert state.arms["arm"].positions[0] > before + 0.1


def states(description: WorldDescription, steps: int) -> bytes:
    world, content = World(description), b""
    hand = ScriptedHand(description.hand, "cautery") if description.hand else None
    state = world.state()
    for step in range(steps):
        wrenches = {hand.tool: hand.wrench(state)} if hand else {}
        moves = {"arm": command(world, 0.2 * np.sin(0.01 * step), 0.1)} if state.arms else {}
        state = world.step(moves, wrenches)
        content += world.data.qpos.tobytes() + world.data.qvel.tobytes()
    return content


def test_same_calls_give_the_same_bytes():
    first, second = (replace(open_world(LUMPECTOMY), bodies=(floor(),)) for _ in range(2))
    assert states(first, 300) == states(second, 300)


def test_reset_repeats_the_run_byte_for_byte():
    world = World(world_of(bodies=(floor(), free_box("cube", 0, 0, 30))))
    falls = [[], []]
    for fall in falls:
        world.reset()
        for _ in range(200):
            world.step()
            fall.append(world.data.qpos.tobytes())
    assert falls[0] == falls[1]


def test_free_body_falls_and_comes_to_rest_on_a_fixed_one():
    world = World(world_of(bodies=(floor(), free_box("cube", 0, 0, 30))))
    for _ in range(500):
        state = world.step()
    assert abs(state.bodies["cube"].translation_mm[2] - 10.0) < 0.05
    contacts = world.contacts()
    assert {contact.bodies for contact in contacts} == {("floor", "cube")}
    assert max(contact.depth_mm for contact in contacts) < 0.1


def test_diverged_physics_is_an_error(world):
    world.data.qvel[0] = 1e7
    with pytest.raises(UnstableError, match=r"has diverged at \d.*expected a shorter time step"):
        for _ in range(10):
            world.step()


def test_unknown_arm_is_named(world):
    with pytest.raises(WorldError, match=r"arm 'leg': no such robot; expected one of arm"):
        world.step({"leg": command(world)})


def test_arm_that_presses_a_body_stays_outside_of_it():
    plate = BodyEntry("plate", box("plate", 200, 200, 20), placed("plate", 205, 0, 110), None)
    description = replace(open_world(LUMPECTOMY), bodies=(plate,))
    world = World(description)
    deepest, touched = 0.0, 0
    for _ in range(450):
        state = world.step({"arm": command(world, 0.0, -0.3)})
        between = [c for c in world.contacts() if set(c.bodies) == {"plate", "cautery"}]
        touched += bool(between)
        deepest = max([deepest, *(contact.depth_mm for contact in between)])
    assert touched > 100
    assert deepest < 0.1
    assert state.bodies["cautery"].translation_mm[2] > 119.0
    assert np.abs(state.arms["arm"].efforts[1]) == pytest.approx(5.0)


@pytest.mark.parametrize("self_collision", [False, True])
def test_links_touch_each_other_only_on_request(touch, self_collision):
    world = World(world_of(arm(touch, self_collision=self_collision)))
    world.reset({"arm": {"shoulder": 2.0, "elbow": -1.45}})
    pairs = {frozenset(each.bodies) for each in world.contacts()}
    joined = {frozenset((f"arm/{j.parent}", f"arm/{j.child}")) for j in touch.joints}
    assert bool(pairs) == self_collision
    assert not pairs & joined
