"""A playback on the graph of a session with provenance.kind ``recorded``."""

from pathlib import Path

import pytest
import yaml

from tests.bridge.conftest import CONSTRAINT

pytestmark = pytest.mark.long

DIAGNOSTICS = "/diagnostics:diagnostic_msgs/msg/DiagnosticArray:1000000"
SOURCE = {"tracked_transforms": {}, "clock": "host"}
UNKNOWN = 3
REFUSED = (
    "PLAYBACK refused: poses from a recording, simulated lumpectomy 1 "
    "(simulated: app.synthetic of this project, seed 1; no patient, no phantom); "
    "expected provenance.kind 'simulated' in live.yaml"
)


@pytest.fixture
def config(live_yaml):
    path = live_yaml(SOURCE)
    values = yaml.safe_load(path.read_text())
    values["provenance"] = {"kind": "recorded", "source": "a patient", "licence": "none"}
    path.write_text(yaml.safe_dump(values))
    return str(path)


def is_refused(line):
    """True for the line of a step that refuses a playback; joints are not used either."""
    return line.startswith("UNKNOWN") and "invalid" in line and "[PLAYBACK]" in line


def tracking_of(message):
    parts = {part["name"]: part["message"] for part in message["status"]}
    return parts.get("marginguard: tracking", ""), parts.get("marginguard: source", "")


def test_session_of_a_patient_uses_no_sample_of_a_playback(start, playing, start_receiver, config):
    player = playing()  # here the tracker starts first
    session = start("-m", "app.cli", "live", "--constraint-hz", "50", "--config", config)
    session.line(is_refused)
    receiver = start_receiver(CONSTRAINT, DIAGNOSTICS)
    states, reports = set(), []
    while len(states) < 1 or len(reports) < 3:
        (line,) = receiver.take(1)
        if line["topic"] == "/marginguard/constraint":
            states.add(line["message"]["state"])
            assert line["message"]["hold"]
        elif (report := tracking_of(line["message"]))[0]:
            reports.append(report)
    assert states == {UNKNOWN}
    for tracking, source in reports:
        assert REFUSED in tracking
        assert source.startswith("PLAYBACK: poses from a recording, simulated lumpectomy 1")
    assert session.process.poll() is None
    assert player.process.poll() is None
    session.stop()
    log = session.log.read_text()
    assert log.count("PLAYBACK refused: poses from a recording") == 1
    assert "PLAYBACK: poses from a recording, simulated lumpectomy 1" in log


def test_playback_is_not_recorded_as_a_patient(start, playing, config, tmp_path):
    playing()
    case = tmp_path / "case"
    recorder = start("-m", "app.cli", "record", "-o", str(case), "--config", config)
    assert recorder.wait() == 2
    assert "a recording is played on this graph" in recorder.log.read_text()


def test_session_of_a_patient_uses_no_pose_of_a_replay(start, start_receiver, config, project_root):
    values = yaml.safe_load(Path(config).read_text())
    values["source"] = {"tf": {}, "clock": "estimate"}
    Path(config).write_text(yaml.safe_dump(values))
    case = str(project_root / "data" / "recorded_case")
    replay = start("-m", "app.cli", "replay", case, "--rate", "1", "--loop")
    start_receiver(CONSTRAINT)  # returns when the replay publishes it
    beside = start("-m", "app.cli", "live", "--config", config)
    assert beside.wait() == 2  # the replay publishes the same constraint
    assert "node /marginguard publishes the constraint already" in beside.log.read_text()
    session = start("-m", "app.cli", "live", "--config", config, "--namespace", "patient")
    session.line(is_refused)
    assert replay.process.poll() is None
    session.stop()
    log = session.log.read_text()
    # The name of the case may arrive after the first refusal.
    assert log.count("PLAYBACK refused: poses from a recording") == 1
    assert "NEGATIVE" not in log
