"""A peer that loosens a live session gets no permission before an operator's re-arm."""

import json
from pathlib import Path

import pytest

from tests.bridge.conftest import TF

pytestmark = pytest.mark.slow

HERE = Path(__file__).resolve().parent
PEER = HERE / "authority_peer.py"
SENDER = HERE.parent / "live" / "sender.py"


@pytest.fixture
def audited(start_sender, start, live_yaml, tmp_path):
    """A live session with a sender, and its audit log."""
    config = str(live_yaml(TF, stale_after_ms=5_000.0))
    audit = tmp_path / "audit.jsonl"
    options = ("--constraint-hz", "100", "--config", config, "--audit", str(audit))
    live = start("-m", "app.cli", "live", *options)
    start_sender("tf", "again")
    return live, audit


def test_no_attempt_to_loosen_is_permitted_without_a_rearm_that_names_it(start, audited):
    live, audit = audited
    peer = start(PEER)

    def reported():
        return json.loads(peer.line(lambda line: line.startswith("{")))

    loosened = reported()
    assert loosened["set"]
    text = "stop_mm lowered from 1 to 0.5, stale_after_ms raised from 5000 to 10000"
    assert loosened["causes"][0] == text
    for refusal in ("not published yet", "nonce is 0", "nonce is 4711"):
        reply = reported()
        assert not reply["success"]
        assert refusal in reply["message"]
    assert reported()["tumor"]
    for _ in range(2):  # at once, and with the seq of a constraint that shows the new tumour
        assert not reported()["success"]
    tumor = reported()
    assert tumor["permissive"] == 0
    assert tumor["causes"][0] == text
    assert tumor["causes"][1].startswith(
        "tumour replaced: THE VOLUME DIFFERS BY MORE THAN A FACTOR OF 2; "
    )
    assert reported() == {"freed": True}
    live.stop()
    lines = [json.loads(line) for line in audit.read_text().splitlines()]
    requests = [(line["kind"], line["accepted"]) for line in lines if line["event"] == "request"]
    assert ("set_margins", True) in requests
    assert ("set_tumor", True) in requests
    assert requests.count(("rearm", False)) >= 5
    assert lines[0]["event"] == "start"
    assert lines[-1]["event"] == "stop"
    # The looser margins apply with the re-arm, not before.
    stops = [line["margins"]["stop_mm"] for line in lines if "margins" in line]
    assert stops[0] == 1.0
    assert stops[-1] == 0.5
    assert "Traceback" not in live.log.read_text()
