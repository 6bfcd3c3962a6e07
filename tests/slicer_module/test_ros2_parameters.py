"""Parameters of an rclpy process in the ROS2 module."""

import pytest

from app.geometry import MarginGuardError

pytestmark = pytest.mark.slow

KINDS = {
    "flag": "bool",
    "count": "integer",
    "gain": "double",
    "text": "string",
    "flags": "bool_array",
    "counts": "integer_array",
    "gains": "double_array",
    "texts": "string_array",
}
"""Parameter of the peer -> its type."""


@pytest.fixture
def parameters(node, peer):
    return node.CreateAndAddParameterNode("/peer")


@pytest.fixture
def events(parameters):
    received = []
    parameters.AddObserver(parameters.ParameterModifiedEvent, lambda *_: received.append(1))
    return received


def test_every_parameter_type_is_received_with_name_and_value(parameters, events, spin_until):
    assert parameters.GetName() == "ros2:param:/peer"
    assert parameters.GetMonitoredNodeName() == "/peer"
    for name in KINDS:
        assert parameters.GetParameterType(name) == ""
        assert parameters.AddParameter(name) is True
        assert parameters.AddParameter(name) is False
    spin_until(lambda: all(parameters.IsParameterSet(name) for name in KINDS))
    assert parameters.IsAddedToROS2Node() and parameters.IsMonitoredNodeReady()
    assert 1 <= len(events) <= len(KINDS)
    assert {name: parameters.GetParameterType(name) for name in KINDS} == KINDS
    assert parameters.PrintParameter("count") == "7"
    before = len(events)
    for _ in range(5):
        parameters.spin()
    assert len(events) == before


def test_change_is_one_event_requested_or_not(parameters, events, peer, spin_until):
    parameters.AddParameter("count")
    spin_until(lambda: parameters.IsParameterSet("count"))
    before = len(events)
    assert peer("set_parameter", name="count", value=150)
    spin_until(lambda: parameters.GetParameterAsInteger("count") == 150)
    assert len(events) == before + 1
    assert not parameters.IsParameterSet("gain", True)
    assert peer("set_parameter", name="gain", value=2.25)
    spin_until(lambda: parameters.IsParameterSet("gain", True))
    assert parameters.GetParameterAsDouble("gain") == 2.25
    assert peer("set_parameter", name="count", value=7)
    assert peer("set_parameter", name="gain", value=1.5)


def test_unset_parameter_or_other_type_has_no_value(parameters, peer, spin_until, caplog):
    for name in ("unset", "never", "text"):
        parameters.AddParameter(name)
    spin_until(lambda: parameters.IsParameterSet("text"))
    for name in ("unset", "never", "not monitored"):
        assert parameters.IsParameterSet(name, True) is False
        assert parameters.GetParameterType(name) == ""
        assert parameters.PrintParameter(name) == "parameter not found"
        with pytest.raises(MarginGuardError, match="is not known"):
            parameters.GetParameterAsString(name)
    with pytest.raises(MarginGuardError, match="'text' of /peer is string; expected integer"):
        parameters.GetParameterAsInteger("text")
    assert not caplog.records
    assert parameters.IsParameterSet("not monitored") is False
    assert "'not monitored' is not monitored" in caplog.text
    assert peer("set_parameter", name="unset", value=3)
    spin_until(lambda: parameters.IsParameterSet("unset"))
    assert parameters.GetParameterType("unset") == "integer"
    assert peer("set_parameter", name="unset", value=3.0)
    spin_until(lambda: parameters.GetParameterType("unset") == "double")
    assert peer("set_parameter", name="unset", value=None)
    spin_until(lambda: not parameters.IsParameterSet("unset"))


def test_removed_parameter_gives_no_more_events(parameters, events, peer, spin_until):
    for name in ("count", "gain"):
        parameters.AddParameter(name)
    spin_until(lambda: parameters.IsParameterSet("count") and parameters.IsParameterSet("gain"))
    assert parameters.RemoveParameter("count") is True
    assert parameters.RemoveParameter("count") is False
    assert parameters.RemoveParameter("never") is False
    before = len(events)
    assert peer("set_parameter", name="count", value=8)
    # Sent after the change of "count", which has therefore arrived with it.
    assert peer("set_parameter", name="gain", value=3.5)
    spin_until(lambda: parameters.GetParameterAsDouble("gain") == 3.5)
    assert len(events) == before + 1
    assert not parameters.IsParameterSet("count", True)
    assert parameters.GetMonitoredParameters() == ("gain",)
    assert peer("set_parameter", name="count", value=7)
    assert peer("set_parameter", name="gain", value=1.5)


def test_parameter_node_is_unique_per_ros_node_and_removable(node, peer, parameters):
    assert node.GetParameterNodeByNode("/peer") is parameters
    assert node.GetParameterNodeByNode("peer") is parameters
    assert node.CreateAndAddParameterNode("peer") is None
    assert node.CreateAndAddParameterNode("") is None
    services = {"do": "clients_of", "name": "slicer"}
    assert "/peer/get_parameters" in peer("clients_of", name="slicer")
    assert node.RemoveAndDeleteParameterNode("/peer") is True
    assert node.RemoveAndDeleteParameterNode("/peer") is False
    assert node.RemoveAndDeleteParameterNode("/random_name") is False
    with pytest.raises(MarginGuardError, match="not on a ROS node"):
        parameters.AddParameter("gain")
    peer("wait_until", call=services, value=[])


def test_unavailable_node_is_awaited_without_blocking(node, spin_until):
    waiting = node.CreateAndAddParameterNode("/not_there_yet")
    waiting.AddParameter("gain")
    node.Spin()
    assert not waiting.IsMonitoredNodeReady()
    assert not waiting.IsParameterSet("gain")
