"""A structure is added, switched off, switched on and replaced in a live session by a peer."""

import json
from pathlib import Path

import pytest

from tests.bridge.faults.test_authority import audited as audited

pytestmark = pytest.mark.long

STRUCTURE_PEER = Path(__file__).resolve().parent / "structure_peer.py"


def test_structure_is_added_switched_off_and_on_and_replaced_in_a_live_session(start, audited):
    live, audit = audited
    peer = start(STRUCTURE_PEER)

    def reported():
        found = json.loads(peer.line(lambda line: line.startswith("{")))
        assert (found["success"], found["message"]) == (True, "")
        return found

    both, reason = ["tumor", "vessel"], "resected at 10:42"
    added = reported()
    assert (added["structures"], added["off"], added["causes"]) == (both, {}, [])
    off = reported()
    assert (off["structures"], off["off"]) == ([], {"vessel": reason})
    assert off["causes"][0] == f"structure 'vessel' switched off: {reason}"
    rearmed = reported()
    assert (rearmed["off"], rearmed["causes"]) == ({"vessel": reason}, [])
    on = reported()
    assert (on["structures"], on["off"], on["causes"]) == (both, {}, [])
    replaced = reported()
    assert replaced["causes"][0].startswith("structure 'vessel' replaced: THE VOLUME DIFFERS")
    live.stop()
    lines = [json.loads(line) for line in audit.read_text().splitlines()]
    requests = [
        (each["kind"], each["accepted"], each["text"])
        for each in lines
        if each["event"] == "request" and each["kind"] != "rearm"
    ]
    assert [each[:2] for each in requests] == [
        ("set_structure", True),
        ("switch_structure", True),
        ("switch_structure", True),
        ("set_structure", True),
    ]
    assert requests[1][2] == f"structure 'vessel' switched off: {reason}"
    assert requests[2][2] == "structure 'vessel' is guarded again: it was the other one"
    assert "Traceback" not in live.log.read_text()
