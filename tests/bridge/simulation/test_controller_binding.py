"""An arm follows the controller of its first command alone; the others are processes."""

import math
import signal

import pytest
from std_srvs.srv import Trigger

from app.bridge import RosNode
from app.bridge.simulation.arm_commands import ControllerBinding
from tests.bridge.simulation.stepped_world import simulated as simulated

pytestmark = pytest.mark.slow

OTHER = "another controller commands the arm (node"


def move(simulated):
    """Let the controller, whose name the graph lists, move the arm."""
    senders = simulated.ros.node.get_publishers_info_by_topic
    simulated.round_until(
        lambda _: [each.node_name for each in senders("/arm/servo_jv")] == ["arm_peer"]
    )
    simulated.round_until(lambda _: simulated.arm.velocities[0] > 0.1, simulated.velocity(0.2))


def stands(simulated, peer):
    """True if the arm comes to a stop, and stands while ``peer`` commands its first joint on."""

    def speed():
        return abs(simulated.arm.velocities[0])

    simulated.round_until(lambda _: speed() < 1e-3, simulated.velocity(0.3))
    speeds, followed = [], []
    for _ in range(20):
        simulated.round(simulated.velocity(0.3), peer=peer)
        speeds.append(speed())
        followed.append(simulated.arm.command)
    return max(speeds) < 1e-3 and followed == [None] * 20


def enable(simulated):
    client = simulated.ros.node.create_client(Trigger, "/arm/enable")
    reply = client.call_async(Trigger.Request())
    simulated.round_until(lambda _: reply.done())
    simulated.round(steps=1)


def test_controller_that_follows_another_is_refused_until_the_operator_accepts_it(simulated):
    move(simulated)
    simulated.peer.end_input()
    simulated.peer.wait()
    simulated.peer = simulated.add_peer(idle=True)
    count = simulated.ros.node.count_publishers
    simulated.round_until(lambda _: count("/arm/servo_jv") == 0)
    simulated.world.fail("arm", "the physics was 40 ms behind real time")
    for _ in range(20):
        simulated.round(simulated.velocity(0.3))
    assert simulated.arm.fault.startswith("the physics")
    enable(simulated)  # after another fault: the binding remains
    simulated.round_until(lambda _: bool(simulated.arm.fault), simulated.velocity(0.3))
    assert simulated.arm.fault.startswith(OTHER)
    assert simulated.arm.fault.endswith("expected node /arm_peer, its first one")
    assert stands(simulated, simulated.peer)
    enable(simulated)
    simulated.round_until(lambda _: simulated.arm.velocities[0] > 0.25, simulated.velocity(0.3))
    assert simulated.arm.fault == ""


def test_publisher_alone_after_a_killed_controller_is_a_fault(simulated):
    move(simulated)
    simulated.peer.end(signal.SIGKILL)
    simulated.peer = simulated.add_peer(idle=True)
    command = {"topic": "move_jp", "names": simulated.joints, "position": [0.0] * 6}
    simulated.round(command)
    simulated.round_until(lambda _: bool(simulated.arm.fault))
    # The graph lists the publisher of a killed process for some seconds.
    assert "senders" in simulated.arm.fault or simulated.arm.fault.startswith(OTHER)


def test_another_node_of_the_process_is_another_controller(simulated):
    move(simulated)
    bad = {"names": simulated.joints, "velocity": [math.nan] * 6}
    simulated.round_until(lambda _: bool(simulated.arm.fault), bad)
    enable(simulated)  # after an invalid command: the binding remains
    move(simulated)
    simulated.round({"topic": "node", "values": "other_node"})
    simulated.round_until(lambda _: bool(simulated.arm.fault), simulated.velocity(0.3))
    assert simulated.arm.fault == f"{OTHER} /other_node); expected node /arm_peer, its first one"
    assert stands(simulated, simulated.peer)


def test_message_of_a_publisher_that_the_graph_does_not_list_is_refused(domain_id):
    first, other = bytes(range(16)), bytes(range(1, 17))
    another_topic = first[:12] + bytes(4)
    with RosNode("binding", domain_id=domain_id) as ros:
        binding = ControllerBinding(ros.node, ["/arm/servo_jv"])
        assert binding.accepts(first)
        assert binding.accepts(another_topic)
        assert binding.problem() == ""
        assert not binding.accepts(other)
        assert not binding.accepts(first)  # nothing until the release
        assert binding.problem() == (
            "another controller commands the arm (node without a known name); "
            "expected node without a known name, its first one"
        )
        binding.release()
        assert binding.accepts(other)
        assert binding.problem() == ""
