"""Interoperability with Cyclone DDS, with discovery restricted to this machine."""

from pathlib import Path

import pytest
from std_srvs.srv import Trigger
from tf2_msgs.msg import TFMessage

from app.bridge import messages
from app.bridge.calls import ServiceServer
from app.bridge.node import RosNode
from app.bridge.topics import TF
from app.geometry import Stamp, Transform
from tests.bridge.conftest import CYCLONE_ON_THIS_MACHINE
from tests.waiting import DEADLINE_S

pytestmark = pytest.mark.slow

CALLER = Path(__file__).resolve().parent / "cyclone_caller.py"

START_NS = 1_700_000_000_000_000_001


def test_cyclone_dds_receives_tf_field_by_field(domain_id, start_cyclone):
    quarter_turn_about_z = [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]
    transform = Transform("tumor", "virtual_fixture", quarter_turn_about_z, [1.0, 20.0, -300.0])
    with RosNode("sender", domain_id=domain_id) as ros:
        publisher = ros.publisher(TF)
        listener = start_cyclone("virtual_fixture", "20")
        assert ros.wait_for_subscribers(TF, 1, timeout_s=DEADLINE_S)
        for number in range(20):
            stamp = Stamp(START_NS + number)
            publisher.publish(TFMessage(transforms=[messages.transform_message(transform, stamp)]))
        received = listener.messages()
    assert [line["stamp_ns"] for line in received] == [START_NS + n for n in range(20)]
    assert {(line["parent"], line["child"]) for line in received} == {("tumor", "virtual_fixture")}
    for line in received:
        assert line["translation"] == [0.001, 0.02, -0.3]
        half = 0.5**0.5
        for value, expected in zip(line["rotation"], [0.0, 0.0, half, half], strict=True):
            assert abs(value - expected) < 1e-15


def test_cyclone_dds_calls_a_service_and_reads_a_parameter(domain_id, start_receiver):
    def ping(_: Trigger.Request, response: Trigger.Response) -> None:
        response.success, response.message = True, "pong"

    with RosNode("server", domain_id=domain_id) as ros:
        ros.node.declare_parameter("stop_mm", 1.25)
        ServiceServer(ros, Trigger, "~/ping", ping)
        arguments = ("/server", "stop_mm")
        caller = start_receiver(*arguments, script=CALLER, environment=CYCLONE_ON_THIS_MACHINE)
        replies = caller.messages()
    double = 3  # rcl_interfaces/ParameterType
    assert replies == [{"success": True, "message": "pong"}, {"type": double, "value": 1.25}]
