"""Margins set by another process: a set is applied or refused as a whole, with the reason."""

import json
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.bridge.calls.errors import CallError
from app.bridge.control import MarginParameterServer
from app.bridge.control.margin_parameters import margins_of
from app.bridge.node import RosNode
from app.fixture import MarginParameterError, MarginParameters

SETTER = Path(__file__).resolve().parents[1] / "calls" / "parameter_setter.py"


def appending_to(used):
    """Function that appends the margins that it is called with."""
    return lambda margins, origin: used.append(margins)


def test_margin_parameters_have_unit_and_range(ros, content, start_receiver):
    MarginParameterServer(ros, content.margins, lambda margins, origin: None)
    requests = ["stop_mm", "stale_after_ms", "release_samples", "k_tre"]
    setter = start_receiver("marginguard", *map(json.dumps, requests), script=SETTER)
    found = dict(zip(requests, setter.take(len(requests)), strict=True))
    assert found["stop_mm"]["value"] == 1.0
    assert (found["stop_mm"]["unit"], found["stop_mm"]["range"]) == ("unit: mm", [[0.0, 100.0]])
    assert found["stale_after_ms"]["value"] == 200.0
    assert found["stale_after_ms"]["unit"] == "unit: ms"
    assert found["stale_after_ms"]["range"][0][1] == 10_000.0
    assert (found["release_samples"]["value"], found["release_samples"]["range"]) == (
        3,
        [[1, 1000]],
    )
    assert found["k_tre"]["value"] == 2.0


def test_margins_are_applied_or_refused_as_a_whole(ros, content, start_receiver):
    used = []
    server = MarginParameterServer(ros, content.margins, appending_to(used))
    setter = start_receiver(
        "marginguard",
        json.dumps({"stop_mm": 6.0, "warn_mm": 9.0}),
        json.dumps({"stop_mm": 8.0, "warn_mm": 7.0}),
        json.dumps({"stop_mm": 2.0, "k_tre": 11.0}),
        json.dumps({"stop_mm": float("nan")}),
        json.dumps({"release_samples": 0}),
        json.dumps({"stop_mm": "wide"}),
        json.dumps({"stale_after_ms": 50.5}),
        json.dumps("stop_mm"),
        script=SETTER,
    )
    first, crossed, far, nan, none, text, stale, stop = setter.take(8)
    assert first["ok"]
    assert stale["ok"]
    for refused in (crossed, far, nan, none, text):
        assert not refused["ok"]
        assert refused["reason"]
    assert "warn_mm is 7; expected more than stop_mm 8" in crossed["reason"]
    assert stop["value"] == 6.0
    first_set = content.margins.replaced(stop_mm=6.0, warn_mm=9.0)
    assert used == [first_set, first_set.replaced(stale_after_ns=50_500_000)]
    assert server.margins == used[-1]


def test_initial_margins_are_validated_and_applied(domain_id, content):
    def start(*values):
        arguments = ["--ros-args", *(part for value in values for part in ("-p", value))]
        with RosNode("marginguard", domain_id=domain_id, ros_args=arguments) as ros:
            used = []
            MarginParameterServer(ros, content.margins, appending_to(used))
            return used

    assert start() == []
    assert start("stop_mm:=3.0") == [content.margins.replaced(stop_mm=3.0)]
    with pytest.raises(CallError, match="warn_mm is 5; expected more than stop_mm 9"):
        start("stop_mm:=9.0")


def test_parameters_of_ros_itself_cannot_be_set(ros, content, start_receiver):
    used = []
    MarginParameterServer(ros, content.margins, appending_to(used))
    requests = [
        {"use_sim_time": True},
        {"stop_mm": 2.0, "use_sim_time": True},
        {"nonsense": 1.0},
    ]
    setter = start_receiver("marginguard", *map(json.dumps, requests), script=SETTER)
    for refused in setter.take(3):
        assert not refused["ok"]
        assert refused["reason"]
    assert used == []
    assert ros.node.get_parameter("use_sim_time").value is False


@given(st.integers(1, 10**10), st.integers(1, 6 * 10**10))
def test_milliseconds_are_converted_exactly_to_nanoseconds(stale_ns, frozen_ns):
    margins = MarginParameters(1.0, 5.0, 2.0, 50.0, stale_ns, 3, 0.5, frozen_ns)
    values = {
        "stop_mm": 1.0,
        "warn_mm": 5.0,
        "k_tre": 2.0,
        "v_max_mm_s": 50.0,
        "stale_after_ms": stale_ns / 1e6,
        "release_samples": 3,
        "release_band_mm": 0.5,
        "frozen_after_ms": frozen_ns / 1e6,
    }
    assert margins_of(values) == margins


def test_missing_margin_is_refused():
    with pytest.raises(MarginParameterError, match="stop_mm is None; expected a number"):
        margins_of({})


def test_set_from_this_process_is_validated_as_over_ros(ros, content):
    used = []
    server = MarginParameterServer(ros, content.margins, appending_to(used))
    server.set(stop_mm=6.0, warn_mm=9.0)
    assert used == [server.margins] == [content.margins.replaced(stop_mm=6.0, warn_mm=9.0)]
    assert ros.node.get_parameter("stop_mm").value == 6.0
    with pytest.raises(MarginParameterError, match="warn_mm is 7; expected more than stop_mm 8"):
        server.set(stop_mm=8.0, warn_mm=7.0)
    assert ros.node.get_parameter("warn_mm").value == 9.0
    assert len(used) == 1


def test_origin_of_a_set_and_reasons_of_refusals_are_passed_on(ros, content, start_receiver):
    origins, reasons = [], []
    server = MarginParameterServer(
        ros, content.margins, lambda margins, origin: origins.append(origin), reasons.append
    )
    server.set(stop_mm=2.0)
    # The second one is refused by ROS, which checks the declared range itself.
    requests = [{"stop_mm": 1.5}, {"stop_mm": 4000.0}, {"warn_mm": 0.5}]
    setter = start_receiver("marginguard", *map(json.dumps, requests), script=SETTER)
    setter.take(3)
    assert origins == ["this process", "ROS"]
    (reason,) = reasons
    assert "warn_mm is 0.5; expected more than stop_mm 1.5" in reason


def test_refusal_of_the_user_of_the_margins_is_not_passed_on_twice(ros, content):
    reasons = []

    def refuse(margins, origin):
        raise MarginParameterError("no operator")

    server = MarginParameterServer(ros, content.margins, refuse, reasons.append)
    with pytest.raises(MarginParameterError, match="no operator"):
        server.set(stop_mm=2.0)
    assert reasons == []
