"""The shipped world as a whole: hand, tracker and physics repeat byte for byte."""

import numpy as np
import pytest

from app.simulation import ScriptedHand, World, WorldTracker, open_world
from tests.simulation.conftest import LUMPECTOMY

pytestmark = pytest.mark.long


def recorded(steps: int) -> tuple[bytes, list[int]]:
    description = open_world(LUMPECTOMY)
    world = World(description)
    assert description.hand is not None and description.tracker is not None
    hand = ScriptedHand(description.hand, "cautery")
    tracker = WorldTracker(description.tracker, description.seed)
    state, content, arrivals = world.state(), b"", []
    for _ in range(steps):
        state = world.step({}, {hand.tool: hand.wrench(state)})
        tracker.observe(state)
        for sample in tracker.arrived(state.time_ns):
            arrivals.append(state.time_ns - sample[0].stamp.ns)
            content += b"".join(each.transform.matrix.tobytes() for each in sample)
        content += world.data.qpos.tobytes()
    return content, arrivals


def test_shipped_world_repeats_byte_for_byte():
    content, arrivals = recorded(1500)
    assert (content, arrivals) == recorded(1500)
    assert len(arrivals) == 75
    assert set(arrivals) == {0}  # a stamp is late by the latency


def test_arm_without_commands_stands_while_the_hand_pushes():
    world = World(open_world(LUMPECTOMY))
    assert world.description.hand is not None
    hand = ScriptedHand(world.description.hand, "cautery")
    start = world.state().bodies["cautery"].translation_mm
    state, forces = world.state(), []
    for _ in range(2000):
        wrench = hand.wrench(state)
        forces.append(float(np.linalg.norm(wrench.force_n)))
        state = world.step({}, {hand.tool: wrench})
    assert max(forces) > 9.99
    assert np.linalg.norm(state.bodies["cautery"].translation_mm - start) < 0.5
