"""A simulated world against a controller in another process; the test decides when it steps."""

import json
import time
from pathlib import Path

import numpy as np
import pytest

from app.bridge import RosNode
from app.bridge.simulation import NODE_NAME, RealTime, SimulationNode
from app.geometry import SurfaceMesh, Transform
from app.simulation import World, open_world
from tests.simulation.conftest import box

PEER = Path(__file__).with_name("arm_peer.py")
ROUNDS = 3000


def at(name, x, y=0.0, z=0.0, frame="world"):
    return Transform(frame, name, np.eye(3), np.array([x, y, z]))


def cube(name, x=0.0):
    mesh = box(name, 20.0, 20.0, 20.0)
    return SurfaceMesh(name, mesh.vertices_mm + np.array([x, 0.0, 0.0]), mesh.faces)


class SteppedWorld:
    """A world with its node; the test steps it."""

    def __init__(self, ros, description, **options):
        self.ros, self.world = ros, World(description)
        self.node = SimulationNode(ros, description, **options)
        self.pace = RealTime(
            self.world, clock_ns=time.monotonic_ns, host_ns=time.time_ns, wait=time.sleep
        )

    def step(self):
        state = self.node.step(self.world, time.time_ns())
        self.node.publish(state, time.time_ns())

    def refusals_are_received(self):
        """True once the simulation has found a subscriber of its refusals."""
        refusals = [each for each in self.ros.node.publishers if "refused" in each.topic_name]
        return min(each.get_subscription_count() for each in refusals) > 0

    def x(self, body):
        return float(self.world.state().bodies[body].translation_mm[0])

    @property
    def arm(self):
        return self.world.state().arms["arm"]


class Simulated(SteppedWorld):
    """The world, its node and the peer; each round is one command and some steps."""

    def __init__(self, ros, description, start, **options):
        super().__init__(ros, description, **options)
        self.node.serve(self.pace)
        self.joints = list(self.arm.joints)
        self._start = start
        self.peer = self.add_peer()
        self.round_until(lambda seen: {"measured_js", "diagnostics", "tumor_sensor"} <= set(seen))

    def add_peer(self, idle=False):
        """Start a peer; an ``idle`` one has no publisher before its first command."""
        peer = self._start(PEER, *(["idle"] if idle else []))
        peer.line()
        return peer

    def round(self, command=None, steps=10, peer=None):
        """Send a command, take steps, and return what the peer has seen."""
        peer = peer or self.peer
        peer.send(json.dumps(command or {}))
        seen = json.loads(peer.line())
        for _ in range(steps):
            self.step()
        self.node.report(1.0, 0)
        return seen

    def round_until(self, condition, command=None):
        for _ in range(ROUNDS):
            seen = self.round(command)
            if condition(seen):
                return seen
        pytest.fail(f"not within {ROUNDS} rounds: {seen}")

    def velocity(self, first, **more):
        return {"names": self.joints, "velocity": [first] + [0.0] * 5, **more}


@pytest.fixture(params=[False])
def simulated(request, domain_id, project_root, start):
    """The lumpectomy; its scripted hand pushes the arm with the parameter True alone."""
    description = open_world(project_root / "data" / "worlds" / "lumpectomy")
    with RosNode(NODE_NAME, domain_id=domain_id) as ros:
        yield Simulated(ros, description, start, use_hand=request.param)
