"""``/clock`` of a simulated world, with a listener and a guard that are processes of their own."""

import time

import pytest
from rosgraph_msgs.msg import Clock

from app.bridge import RosNode
from app.bridge.simulation import NODE_NAME, SimulationNode
from app.bridge.topics import INCOMING, Topic
from app.cli.main import main
from app.simulation import World, open_world
from tests.bridge.nodes import ros_nodes
from tests.waiting import wait_until

pytestmark = pytest.mark.slow

GUARD = ("-m", "benchmarks.closed_loop.stand_ins", "guard")
"""A test double: publishes constraints."""


@pytest.fixture
def world(project_root):
    return World(open_world(project_root / "data" / "worlds" / "lumpectomy"))


class Clocks:
    """The simulation with its clock, and another node that listens to it."""

    def __init__(self, ros, listener, world):
        self.node = SimulationNode(ros, world.description, clock=True)
        self.world, self.stamps, self.heard = world, [], []
        listener.subscribe(Topic("/clock", Clock, INCOMING), self._take)

    def step(self):
        state = self.node.step(self.world, time.time_ns())
        stamp_ns = time.time_ns()
        self.stamps.append(stamp_ns)
        self.node.publish(state, stamp_ns)

    def until(self, condition):
        wait_until(condition, self.step, pause_s=0.001)

    def _take(self, message):
        self.heard.append(message.clock.sec * 10**9 + message.clock.nanosec)


@pytest.fixture
def clocks(domain_id, world):
    with ros_nodes(domain_id, NODE_NAME, "listener") as (ros, listener):
        yield Clocks(ros, listener, world)


def test_clock_is_that_of_the_states_and_ends_when_a_guard_appears(clocks, start):
    clocks.until(lambda: len(clocks.heard) > 5)
    assert clocks.node.clock.problem == ""
    assert set(clocks.heard) <= set(clocks.stamps)
    assert clocks.heard == sorted(clocks.heard)
    start(*GUARD).line()
    clocks.until(lambda: clocks.node.clock.problem)
    # The name of the node may follow its publisher.
    assert "guards with /marginguard/constraint; expected no guard" in clocks.node.clock.problem
    ended_ns = clocks.stamps[-1]
    for _ in range(100):
        clocks.step()
    assert max(clocks.heard) <= ended_ns


def test_clock_is_never_published_beside_a_guard_that_runs_already(domain_id, world, start):
    start(*GUARD).line()
    with ros_nodes(domain_id, NODE_NAME, "listener") as (ros, listener):
        clocks = Clocks(ros, listener, world)
        wait_until(lambda: clocks.node.clock.problem)
        for _ in range(100):
            clocks.step()
        assert clocks.heard == []


def test_second_clock_ends_the_first(clocks, domain_id):
    clocks.until(lambda: clocks.heard)
    with RosNode("player", domain_id=domain_id) as player:
        player.publisher(Topic("/clock", Clock, INCOMING))
        clocks.until(lambda: clocks.node.clock.problem)
    assert "publish it; expected one node" in clocks.node.clock.problem


def test_clock_beside_a_guard_of_the_same_command_is_refused(capsys, project_root):
    world = project_root / "data" / "worlds" / "lumpectomy"
    assert main(["simulate", str(world), "--clock", "--with", "live"]) == 2
    assert "--clock with --with or --view; expected one of them" in capsys.readouterr().err
