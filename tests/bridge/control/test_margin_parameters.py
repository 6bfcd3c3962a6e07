"""Margins set by another process: a set is applied or refused as a whole, with the reason."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.bridge.control.operator_requests import MarginParameterServer, margins_of
from app.bridge.node import RosNode
from app.bridge.ros_errors import CallError
from app.fixture import MarginParameterError, MarginParameters
from tests.bridge.service_calls import CALLER, asking, setting

pytestmark = pytest.mark.slow


def appending_to(used):
    """Function that appends the margins that it is called with."""
    return lambda margins, origin: used.append(margins)


def test_margin_parameters_have_unit_and_range(ros, content, start_receiver):
    MarginParameterServer(ros, content.margins, lambda margins, origin: None)
    names = ["stop_mm", "stale_after_ms", "release_samples", "k_tre"]
    calls = [call for name in names for call in asking(name)]
    replies = start_receiver(*calls, script=CALLER).messages()
    values = dict(zip(names, (each["values"][0] for each in replies[::2]), strict=True))
    about = dict(zip(names, (each["descriptors"][0] for each in replies[1::2]), strict=True))
    assert values["stop_mm"]["double_value"] == 1.0
    assert about["stop_mm"]["additional_constraints"] == "unit: mm"
    (stop,) = about["stop_mm"]["floating_point_range"]
    assert (stop["from_value"], stop["to_value"]) == (0.0, 100.0)
    assert values["stale_after_ms"]["double_value"] == 200.0
    assert about["stale_after_ms"]["additional_constraints"] == "unit: ms"
    assert about["stale_after_ms"]["floating_point_range"][0]["to_value"] == 10_000.0
    assert values["release_samples"]["integer_value"] == 3
    (samples,) = about["release_samples"]["integer_range"]
    assert (samples["from_value"], samples["to_value"]) == (1, 1000)
    assert values["k_tre"]["double_value"] == 2.0


def results_of(start_receiver, *values):
    """Whether each set of these values succeeded, and why not."""
    replies = start_receiver(*map(setting, values), script=CALLER).messages()
    return [(each["result"]["successful"], each["result"]["reason"]) for each in replies]


def test_margins_are_applied_or_refused_as_a_whole(ros, content, start_receiver):
    used = []
    server = MarginParameterServer(ros, content.margins, appending_to(used))
    first, crossed, *refused, stale = results_of(
        start_receiver,
        {"stop_mm": 6.0, "warn_mm": 9.0},
        {"stop_mm": 8.0, "warn_mm": 7.0},
        {"stop_mm": 2.0, "k_tre": 11.0},
        {"stop_mm": math.nan},
        {"release_samples": 0},
        {"stop_mm": "wide"},
        {"stale_after_ms": 50.5},
    )
    assert first[0] and stale[0]
    for succeeded, reason in (crossed, *refused):
        assert not succeeded and reason
    assert "warn_mm is 7; expected more than stop_mm 8" in crossed[1]
    assert ros.node.get_parameter("stop_mm").value == 6.0
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
    requests = {"use_sim_time": True}, {"stop_mm": 2.0, "use_sim_time": True}, {"nonsense": 1.0}
    for succeeded, reason in results_of(start_receiver, *requests):
        assert not succeeded and reason
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
    server.set(stop_mm=6.0, warn_mm=9.0, origin="the page")
    assert used == [server.margins] == [content.margins.replaced(stop_mm=6.0, warn_mm=9.0)]
    assert ros.node.get_parameter("stop_mm").value == 6.0
    with pytest.raises(MarginParameterError, match="warn_mm is 7; expected more than stop_mm 8"):
        server.set(stop_mm=8.0, warn_mm=7.0, origin="the page")
    assert ros.node.get_parameter("warn_mm").value == 9.0
    assert len(used) == 1


def test_origin_of_a_set_and_reasons_of_refusals_are_passed_on(ros, content, start_receiver):
    origins, reasons = [], []

    def refused(reason, origin):
        reasons.append((reason, origin))

    server = MarginParameterServer(
        ros, content.margins, lambda margins, origin: origins.append(origin), refused
    )
    server.set(stop_mm=2.0, origin="the page")
    with pytest.raises(MarginParameterError):
        server.set(stop_mm=7.0, warn_mm=6.0, origin="the page")
    # The second one is refused by ROS, which checks the declared range itself.
    results_of(start_receiver, {"stop_mm": 1.5}, {"stop_mm": 4000.0}, {"warn_mm": 0.5})
    assert origins == ["the page", "ROS"]
    own, other = reasons
    assert own == (
        "warn_mm is 6; expected more than stop_mm 7, as the warning must come before the stop",
        "the page",
    )
    assert "warn_mm is 0.5; expected more than stop_mm 1.5" in other[0]
    assert other[1] == "ROS"


def test_refusal_of_the_user_of_the_margins_is_not_passed_on_twice(ros, content):
    reasons = []

    def refuse(margins, origin):
        raise MarginParameterError("no operator")

    server = MarginParameterServer(
        ros, content.margins, refuse, lambda reason, origin: reasons.append(reason)
    )
    with pytest.raises(MarginParameterError, match="no operator"):
        server.set(stop_mm=2.0, origin="the page")
    assert reasons == []
