"""Live session in a separate process with control rate, parameters, twists and lifecycle."""

import signal
from functools import partial
from pathlib import Path

import pytest
import yaml

from tests.bridge.conftest import CONSTRAINT, TF
from tests.bridge.service_calls import CALLER, setting, transitions

pytestmark = pytest.mark.slow

HERE = Path(__file__).resolve().parent
TWISTS = HERE / "twist_sender.py"
SENDER = HERE.parent / "live" / "sender.py"


def test_margins_set_by_another_process_change_the_constraint_and_a_twist_gets_a_reply(
    start_sender, start, start_receiver, live_yaml
):
    """At the full control rate."""
    live = start("-m", "app.cli", "live", "--config", live_yaml(TF))
    live.line(lambda line: line.startswith("UNKNOWN"))
    command = {"frame": "tumor", "late_s": 0.0, "linear": [0.0, 0.0, 0.1], "angular": [0.0] * 3}
    twists = start(TWISTS)
    twists.line()
    reply = twists.ask({**command, "again": True})
    assert reply["linear"] == pytest.approx([0.0] * 3)  # there is no constraint yet
    requests = setting({"warn_mm": 0.5}), setting({"stop_mm": 21.0, "warn_mm": 150.0})
    replies = start_receiver(*requests, script=CALLER).messages()
    refused, applied = (each["result"] for each in replies)
    assert not refused["successful"]
    assert applied["successful"], applied["reason"]
    receiver = start_receiver(CONSTRAINT)
    start_sender("tf")
    message = receiver.until(lambda message: message["state"] != 3)
    assert message["stop_distance"] >= 0.021
    assert message["warn_distance"] >= 0.15
    live.stop()


WRENCH = "/marginguard/guidance_wrench:geometry_msgs/msg/WrenchStamped:1000000"
GUIDANCE = {
    "force_n": 4.0,
    "range_mm": 100.0,
    "rate_n_s": 1000.0,
    "period_ms": 20.0,
    "delay_ms": 0.0,
    "damping_n_s_m": 5.0,
}


def test_live_session_goes_through_its_lifecycle_and_ends_on_hold(
    start_sender, start, start_receiver, live_yaml
):
    # A long stale age, so that a short stall of the machine does not latch the hold.
    config = live_yaml(TF, stale_after_ms=5_000.0)
    values = yaml.safe_load(config.read_text()) | {"guidance": GUIDANCE}
    config.write_text(yaml.safe_dump(values))
    options = ("--lifecycle", "--constraint-hz", "100", "--config", str(config))
    live = start("-m", "app.cli", "live", *options)
    start_sender("tf", "again")
    # Configure twice to detect resources that the first configuration did not release.
    request_of = partial(transitions, start_receiver)
    cycle = ("configure", "activate", "deactivate", "cleanup", "state")
    assert request_of(*cycle) == [True, True, True, True, "unconfigured"]
    assert request_of("configure", "state") == [True, "inactive"]
    constraints, wrenches = start_receiver(CONSTRAINT, wait=False), start_receiver(WRENCH)
    assert request_of("activate") == [True]
    constraints.wait_until_ready()
    known = constraints.until(lambda message: message["state"] != 3)
    assert not known["hold"]
    # Without a latched hold there is a force within 100 mm of the margin.
    wrenches.until(lambda message: abs(message["wrench"]["force"]["z"]) > 0.1)
    assert request_of("deactivate", "activate") == [True, True]
    constraints.until(lambda message: message["reasons"] == ["inactive"])
    held = constraints.until(lambda message: message["state"] != 3)
    assert held["hold"]
    assert "latched" in held["reasons"]
    live.stop(signal.SIGTERM)
    last = constraints.until(lambda message: message["reasons"] == ["inactive", "latched"])
    assert (last["state"], last["hold"]) == (3, True)
    none = wrenches.until(lambda message: set(message["wrench"]["force"].values()) == {0.0})
    assert set(none["wrench"]["torque"].values()) == {0.0}
