"""A live session in a process of its own, with a control rate, parameters and allowed twists."""

import json
import signal
from pathlib import Path

import pytest
import yaml

from tests.bridge.live.conftest import breach as breach
from tests.bridge.live.conftest import frames_file as frames_file
from tests.bridge.live.conftest import live_yaml as live_yaml
from tests.bridge.live.conftest import start as start

HERE = Path(__file__).resolve().parent
SETTER = HERE.parent / "calls" / "parameter_setter.py"
LEADER = HERE / "lifecycle_client.py"
TWISTS = HERE / "twist_sender.py"
SENDER = HERE.parent / "live" / "sender.py"
CONSTRAINT = "/marginguard/constraint:marginguard_msgs/msg/FixtureConstraint:1000000"


def test_margins_set_by_another_process_act_on_the_constraint(
    start, start_receiver, live_yaml, frames_file
):
    config = str(live_yaml({"tf": {}, "clock": "host"}))
    live = start("-m", "app.cli", "live", "--constraint-hz", "100", "--config", config)
    live.line(lambda line: line.startswith("UNKNOWN"))
    asked = [{"warn_mm": 0.5}, {"stop_mm": 21.0, "warn_mm": 150.0}]
    setter = start_receiver("marginguard", *map(json.dumps, asked), script=SETTER)
    refused, taken = setter.take(2)
    assert not refused["ok"]
    assert taken["ok"], taken["reason"]
    receiver = start_receiver(CONSTRAINT)
    start(str(SENDER), str(frames_file), "tf")
    message = {"state": 3}
    while message["state"] == 3:
        message = receiver.take(1)[0]["message"]
    assert message["stop_distance"] >= 0.021
    assert message["warn_distance"] >= 0.15
    assert live.end(signal.SIGINT) == 130
    assert "Traceback" not in live.log.read_text()


def test_a_twist_is_answered_at_the_full_control_rate(start, start_receiver, live_yaml):
    config = str(live_yaml({"tf": {}, "clock": "host"}))
    live = start("-m", "app.cli", "live", "--config", config)
    live.line(lambda line: line.startswith("UNKNOWN"))
    command = {"frame": "tumor", "late_s": 0.0, "linear": [0.0, 0.0, 0.1], "angular": [0.0] * 3}
    answer = start_receiver(json.dumps(command), script=TWISTS).take(1)[0]
    assert answer["linear"] == pytest.approx([0.0] * 3)  # nothing is known yet
    assert live.end(signal.SIGTERM) == 143
    assert "Traceback" not in live.log.read_text()


WRENCH = "/marginguard/guidance_wrench:geometry_msgs/msg/WrenchStamped:1000000"
GUIDANCE = {
    "force_n": 4.0,
    "range_mm": 100.0,
    "rate_n_s": 1000.0,
    "period_ms": 20.0,
    "delay_ms": 0.0,
    "damping_n_s_m": 5.0,
}


def until(receiver, wanted):
    message = receiver.take(1)[0]["message"]
    while not wanted(message):
        message = receiver.take(1)[0]["message"]
    return message


def lead(start_receiver, *words):
    client = start_receiver("marginguard", *words, script=LEADER)
    return [next(iter(said.values())) for said in client.take(len(words))]


def test_a_session_is_led_through_its_life_cycle_and_ends_on_hold(
    start, start_receiver, live_yaml, frames_file
):
    # A machine that stops for a moment is no fault here: it would latch the hold.
    config = live_yaml({"tf": {}, "clock": "host"}, stale_after_ms=5_000.0)
    values = yaml.safe_load(config.read_text()) | {"guidance": GUIDANCE}
    config.write_text(yaml.safe_dump(values))
    words = ("live", "--lifecycle", "--tip-only", "--constraint-hz", "100", "--config", str(config))
    live = start("-m", "app.cli", *words)
    start(str(SENDER), str(frames_file), "tf", "again")
    # Twice, so that what one configuration leaves behind is in the way of the other.
    back = ("configure", "activate", "deactivate", "cleanup", "state")
    assert lead(start_receiver, *back) == [True, True, True, True, "unconfigured"]
    assert lead(start_receiver, "configure", "state") == [True, "inactive"]
    constraints, wrenches = start_receiver(CONSTRAINT, wait=False), start_receiver(WRENCH)
    assert lead(start_receiver, "activate") == [True]
    constraints.wait_until_ready()
    known = until(constraints, lambda message: message["state"] != 3)
    assert not known["hold"]
    # Without a latched hold there is a force within 100 mm of the margin.
    until(wrenches, lambda message: abs(message["wrench"]["force"]["z"]) > 0.1)
    assert lead(start_receiver, "deactivate", "activate") == [True, True]
    until(constraints, lambda message: message["reasons"] == ["inactive"])
    held = until(constraints, lambda message: message["state"] != 3)
    assert held["hold"]
    assert "latched" in held["reasons"]
    assert live.end(signal.SIGTERM) == 143
    assert "Traceback" not in live.log.read_text()
    last = until(constraints, lambda message: message["reasons"] == ["inactive", "latched"])
    assert (last["state"], last["hold"]) == (3, True)
    none = until(wrenches, lambda message: set(message["wrench"]["force"].values()) == {0.0})
    assert set(none["wrench"]["torque"].values()) == {0.0}
