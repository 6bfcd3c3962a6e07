"""A live session in a process of its own, with a control rate, parameters and allowed twists."""

import json
import signal
from pathlib import Path

import pytest

from tests.bridge.live.conftest import breach as breach
from tests.bridge.live.conftest import frames_file as frames_file
from tests.bridge.live.conftest import live_yaml as live_yaml
from tests.bridge.live.conftest import start as start

HERE = Path(__file__).resolve().parent
SETTER = HERE.parent / "calls" / "parameter_setter.py"
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
