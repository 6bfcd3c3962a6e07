"""Parameters set by another process: all values of a request are applied, or none."""

import math

import pytest

from app.bridge.calls import CallError, ParameterDeclaration, ParameterServer
from app.bridge.node import RosNode
from app.geometry import InputError
from tests.bridge.service_calls import CALLER, asking, setting

pytestmark = pytest.mark.slow

DECLARED = (
    ParameterDeclaration("stop_mm", 1.0, "where motion stops", "mm", 0.0, 50.0),
    ParameterDeclaration("warn_mm", 5.0, "where the colour turns", "mm", 0.0, 100.0),
    ParameterDeclaration("count", 3, "samples", lowest=1, highest=100),
    ParameterDeclaration("name", "touch", "of the robot"),
    ParameterDeclaration("box_mm", (1.0, 2.0), "sides", "mm", 0, 10),
)


def in_order(values):
    if not values["stop_mm"] < values["warn_mm"]:
        raise InputError(
            f"stop {values['stop_mm']:g} mm, warn {values['warn_mm']:g} mm: stop < warn"
        )


def test_parameters_are_set_from_another_process(ros, start_receiver):
    server = ParameterServer(ros, DECLARED, in_order)
    requests = (
        {"stop_mm": 2.0, "warn_mm": 8.0, "name": "arm"},
        {"stop_mm": 9.0, "count": 4},
        {"name": "other", "count": 0},
        {"stop_mm": math.nan},
        {"stop_mm": "near"},
        {"nothing": 1},
        {"box_mm": [1.0, 11.0]},
        {"box_mm": [3.0]},
    )
    value, stop, _, count, *replies = start_receiver(
        *asking("stop_mm"), *asking("count"), *map(setting, requests), script=CALLER
    ).messages()
    assert value["values"][0]["double_value"] == 1.0
    (stop,) = stop["descriptors"]
    assert stop["description"] == "where motion stops"
    assert stop["additional_constraints"] == "unit: mm"
    assert stop["floating_point_range"] == [{"from_value": 0.0, "to_value": 50.0, "step": 0.0}]
    (limits,) = count["descriptors"][0]["integer_range"]
    assert (limits["from_value"], limits["to_value"]) == (1, 100)
    results = [(each["result"]["successful"], each["result"]["reason"]) for each in replies]
    assert results[:2] == [(True, ""), (False, "stop 9 mm, warn 8 mm: stop < warn")]
    assert [succeeded for succeeded, _ in results[2:]] == [False] * 5 + [True]
    assert all(reason for _, reason in results[2:7])
    assert server.values == {
        "stop_mm": 2.0,
        "warn_mm": 8.0,
        "count": 3,
        "name": "arm",
        "box_mm": (3.0,),
    }
    # The values in rclpy are the same.
    assert ros.node.get_parameter("stop_mm").value == 2.0
    assert ros.node.get_parameter("count").value == 3


def test_exception_in_accept_refuses_the_values(ros, start_receiver):
    def accept(values):
        if values["stop_mm"] != 1.0:
            raise ZeroDivisionError("of mine")

    server = ParameterServer(ros, DECLARED, accept)
    (reply,) = start_receiver(setting({"stop_mm": 2.0}), script=CALLER).messages()
    assert reply["result"]["reason"] == "the server failed: ZeroDivisionError: of mine"
    assert not reply["result"]["successful"]
    assert server.values["stop_mm"] == 1.0
    assert server.refused == 1


def test_initial_values_override_the_defaults(domain_id):
    given = ("--ros-args", "-p", "stop_mm:=3.0")
    with RosNode("marginguard", domain_id=domain_id, ros_args=given) as ros:
        assert ParameterServer(ros, DECLARED, in_order).values["stop_mm"] == 3.0


@pytest.mark.parametrize("given", ["stop_mm:=30.0", "stop_mm:=51.0", "stop_mm:=text"])
def test_invalid_initial_values_are_refused(domain_id, given):
    arguments = ("--ros-args", "-p", given)
    with (
        RosNode("marginguard", domain_id=domain_id, ros_args=arguments) as ros,
        pytest.raises(CallError, match="stop") as caught,
    ):
        ParameterServer(ros, DECLARED, in_order)
    assert "\n" not in str(caught.value)


def test_invalid_declaration_is_refused():
    with pytest.raises(CallError, match="stop_mm is 60; expected 0 to 50 mm"):
        ParameterDeclaration("stop_mm", 60.0, "", "mm", 0.0, 50.0)
    with pytest.raises(CallError, match="expected both ends or none"):
        ParameterDeclaration("stop_mm", 1.0, "", "mm", lowest=0.0)
    with pytest.raises(CallError, match="expected a finite number"):
        ParameterDeclaration("stop_mm", float("nan"), "")
