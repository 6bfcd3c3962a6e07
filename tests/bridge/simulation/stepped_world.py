"""A simulated world against a controller in another process; the test decides when it steps."""

import json
import time
from pathlib import Path

import pytest

from app.bridge import RosNode
from app.bridge.simulation import NODE_NAME, RealTime, SimulationNode
from app.simulation import World, open_world

PEER = Path(__file__).with_name("arm_peer.py")
ROUNDS = 3000


class Simulated:
    """The world, its node and the peer; each round is one command and some steps."""

    def __init__(self, ros, description, start):
        self.world = World(description)
        self.node = SimulationNode(ros, description)
        self.pace = RealTime(
            self.world, clock_ns=time.monotonic_ns, host_ns=time.time_ns, wait=time.sleep
        )
        self.node.serve(self.pace)
        self.joints = list(self.world.state().arms["arm"].joints)
        self.ros, self._start = ros, start
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
            state = self.node.step(self.world, time.time_ns())
            self.node.publish(state, time.time_ns())
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

    @property
    def arm(self):
        return self.world.state().arms["arm"]


@pytest.fixture
def simulated(domain_id, project_root, start):
    description = open_world(project_root / "data" / "worlds" / "lumpectomy")
    with RosNode(NODE_NAME, domain_id=domain_id) as ros:
        yield Simulated(ros, description, start)
