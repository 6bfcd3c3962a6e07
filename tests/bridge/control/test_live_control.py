"""Live session in a separate process with control rate, parameters, twists and lifecycle."""

import json
import signal
from pathlib import Path

import pytest
import yaml

HERE = Path(__file__).resolve().parent
SETTER = HERE.parent / "calls" / "parameter_setter.py"
LIFECYCLE = HERE / "lifecycle_client.py"
TWISTS = HERE / "twist_sender.py"
SENDER = HERE.parent / "live" / "sender.py"
CONSTRAINT = "/marginguard/constraint:marginguard_msgs/msg/FixtureConstraint:1000000"


def test_margins_set_by_another_process_change_the_constraint(
    start, start_receiver, live_yaml, frames_file
):
    config = str(live_yaml({"tf": {}, "clock": "host"}))
    live = start("-m", "app.cli", "live", "--constraint-hz", "100", "--config", config)
    live.line(lambda line: line.startswith("UNKNOWN"))
    requests = [{"warn_mm": 0.5}, {"stop_mm": 21.0, "warn_mm": 150.0}]
    setter = start_receiver("marginguard", *map(json.dumps, requests), script=SETTER)
    refused, applied = setter.take(2)
    assert not refused["ok"]
    assert applied["ok"], applied["reason"]
    receiver = start_receiver(CONSTRAINT)
    start(SENDER, str(frames_file), "tf")
    message = {"state": 3}
    while message["state"] == 3:
        message = receiver.take(1)[0]["message"]
    assert message["stop_distance"] >= 0.021
    assert message["warn_distance"] >= 0.15
    assert live.end(signal.SIGINT) == 130
    assert "Traceback" not in live.log.read_text()


def test_twist_gets_a_reply_at_the_full_control_rate(start, start_receiver, live_yaml):
    config = str(live_yaml({"tf": {}, "clock": "host"}))
    live = start("-m", "app.cli", "live", "--config", config)
    live.line(lambda line: line.startswith("UNKNOWN"))
    command = {"frame": "tumor", "late_s": 0.0, "linear": [0.0, 0.0, 0.1], "angular": [0.0] * 3}
    reply = start_receiver(json.dumps(command), script=TWISTS).take(1)[0]
    assert reply["linear"] == pytest.approx([0.0] * 3)  # there is no constraint yet
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


def until(receiver, accept):
    message = receiver.take(1)[0]["message"]
    while not accept(message):
        message = receiver.take(1)[0]["message"]
    return message


def request(start_receiver, *requests):
    client = start_receiver("marginguard", *requests, script=LIFECYCLE)
    return [next(iter(reply.values())) for reply in client.take(len(requests))]


def test_live_session_goes_through_its_lifecycle_and_ends_on_hold(
    start, start_receiver, live_yaml, frames_file
):
    # A long stale age, so that a short stall of the machine does not latch the hold.
    config = live_yaml({"tf": {}, "clock": "host"}, stale_after_ms=5_000.0)
    values = yaml.safe_load(config.read_text()) | {"guidance": GUIDANCE}
    config.write_text(yaml.safe_dump(values))
    options = ("--lifecycle", "--tip-only", "--constraint-hz", "100", "--config", str(config))
    live = start("-m", "app.cli", "live", *options)
    start(SENDER, str(frames_file), "tf", "again")
    # Configure twice to detect resources that the first configuration did not release.
    cycle = ("configure", "activate", "deactivate", "cleanup", "state")
    assert request(start_receiver, *cycle) == [True, True, True, True, "unconfigured"]
    assert request(start_receiver, "configure", "state") == [True, "inactive"]
    constraints, wrenches = start_receiver(CONSTRAINT, wait=False), start_receiver(WRENCH)
    assert request(start_receiver, "activate") == [True]
    constraints.wait_until_ready()
    known = until(constraints, lambda message: message["state"] != 3)
    assert not known["hold"]
    # Without a latched hold there is a force within 100 mm of the margin.
    until(wrenches, lambda message: abs(message["wrench"]["force"]["z"]) > 0.1)
    assert request(start_receiver, "deactivate", "activate") == [True, True]
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
