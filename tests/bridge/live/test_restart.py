"""A live session that was killed or stopped, and the one after it, in processes of their own."""

import os
import re
import signal
from pathlib import Path

import pytest
import yaml

from tests.bridge.conftest import CONSTRAINT, TRACKED
from tests.bridge.live.restarts import REARM, live, refusal

pytestmark = pytest.mark.long

KILLED = re.compile(
    r"guard restarted: the last run \(process (\d+)\) ended without a stop at about "
    r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d"
)


@pytest.fixture
def config(live_yaml):
    return live_yaml(TRACKED, stale_after_ms=2000.0)


def records():
    folder = Path(os.environ["XDG_STATE_HOME"], "marginguard")
    return sorted(folder.glob("*.json"))


def test_killed_guard_restarts_on_hold_with_the_reason_until_an_operator_rearms(
    start_sender, start_live, start, start_receiver, config
):
    guard = start_live(config)
    receiver = start_receiver(CONSTRAINT)
    start_sender("tracked", "again")
    free = receiver.until(lambda message: not message["hold"])
    guard.end(signal.SIGKILL)

    second = start(*live(config, "--json"))
    held = receiver.until(lambda message: message["instance_id"] != free["instance_id"])
    assert held["hold"]
    (cause,) = [cause for cause in held["hold_causes"] if KILLED.match(cause)]
    assert KILLED.match(cause).group(1) == str(guard.process.pid)
    known = receiver.until(lambda message: message["state"] != 3)
    assert known["hold"]
    assert "latched" in known["reasons"]
    assert cause in known["hold_causes"]
    second.line(lambda line: cause in line)  # the JSON line has the causes
    assert f"HOLD: {cause}" in second.log.read_text()
    operator = start(*REARM)
    operator.line(lambda line: line == "re-armed\n")
    rearmed = receiver.until(lambda message: not message["hold"])
    assert rearmed["instance_id"] == known["instance_id"]
    assert rearmed["hold_causes"] == []

    # An orderly end without hold allows the next one to start without.
    second.stop(signal.SIGTERM)
    third = start(*live(config))
    again = receiver.until(
        lambda message: (
            message["instance_id"] not in (free["instance_id"], rearmed["instance_id"])
            and message["state"] != 3
        )
    )
    assert not again["hold"]
    assert "HOLD" not in third.log.read_text()


def test_file_with_another_stop_margin_is_a_start_on_hold_until_an_operator_rearms(
    start_sender, start_live, start, start_receiver, config
):
    guard = start_live(config)
    receiver = start_receiver(CONSTRAINT)
    start_sender("tracked", "again")
    free = receiver.until(lambda message: not message["hold"])
    guard.stop(signal.SIGTERM)
    values = yaml.safe_load(config.read_text())
    stop_mm = values["margins"]["stop_mm"]
    values["margins"]["stop_mm"] = 0.5 * stop_mm
    config.write_text(yaml.safe_dump(values))

    second = start(*live(config))
    known = receiver.until(
        lambda message: message["instance_id"] != free["instance_id"] and message["state"] != 3
    )
    cause = f"not as in the last run: stop_mm lowered from {stop_mm:g} to {0.5 * stop_mm:g}"
    assert known["hold"] and cause in known["hold_causes"]
    assert f"HOLD: {cause}" in second.log.read_text()
    start(*REARM).line(lambda line: line == "re-armed\n")
    assert receiver.until(lambda message: not message["hold"])["hold_causes"] == []


@pytest.mark.parametrize("content", [b"", b"\x00random\xff", b'{"version": 2}'])
def test_damaged_record_is_a_start_on_hold(start_live, start, config, content):
    guard = start_live(config)
    guard.stop()
    for path in records():
        path.write_bytes(content)
    second = start(*live(config))
    second.line(lambda line: line.startswith("UNKNOWN") and "latched" in line)
    assert "HOLD: guard restarted: how the last run ended is not known: " in second.log.read_text()


def test_state_that_cannot_be_written_refuses_the_start(start, config, monkeypatch, tmp_path):
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "file"))
    line = refusal(start(*live(config)))
    assert "cannot be written: Not a directory; expected a writable folder (XDG_STATE_HOME)" in line
