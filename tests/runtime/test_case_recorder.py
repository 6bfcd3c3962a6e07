"""Start, status and end of a recorder, with a program in the place of ``marginguard record``."""

import queue
import sys
from datetime import datetime
from pathlib import Path

import numpy as np
import pytest

from app.case import received_values
from app.geometry import InputError
from app.runtime import CaseRecorder, case_recorder
from app.runtime.case_recorder import RecordingStatus
from tests.case.test_session_values import VALUES

RECORDER = """
import json, sys
from pathlib import Path
folder = Path(sys.argv[sys.argv.index("-o") + 1])
folder.mkdir()
def status(messages, lost):
    print(json.dumps({"status": {"duration_s": 65.0, "messages": messages, "lost": lost,
                                 "topics": {}, "waiting": ["/tf"], "problem": ""}}), flush=True)
print("[INFO] not an object")
status(1, {})
(folder / "arguments").write_text(" ".join(sys.argv[1:]))
FAILS
(folder / "input").write_bytes(sys.stdin.buffer.read())
status(7, {"/tf": 2})
"""
"""TEST DOUBLE of ``marginguard record --json --until-eof``."""

FULL_DISK = """
print(json.dumps({"error": {"message": "tracking_0.mcap cannot be written: No space left"}}),
      file=sys.stderr)
sys.exit(2)
"""
REFUSED = """
import json, sys
print(json.dumps({"error": {"message": "live.yaml: no such file"}}), file=sys.stderr)
sys.exit(2)
"""


def recorder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, program: str) -> CaseRecorder:
    command = [sys.executable, "-c", program]
    monkeypatch.setattr(case_recorder, "_command", lambda: command)
    return CaseRecorder(
        tmp_path / "live.yaml",
        tmp_path / "cases",
        title="lumpectomy (left) 3",
        namespace="room",
        now=lambda: datetime(2026, 3, 4, 5, 6, 7),
    )


def test_recording_is_named_by_case_and_time_and_reports_what_it_wrote(tmp_path, monkeypatch):
    found = recorder(tmp_path, monkeypatch, RECORDER.replace("FAILS", ""))
    assert found.status is None
    with pytest.raises(InputError, match="none is running; expected one"):
        found.stop()
    folder = found.start("", VALUES)
    assert folder == tmp_path / "cases" / "lumpectomy_left_3-20260304-050607"
    assert (tmp_path / "cases").stat().st_mode & 0o077 == 0
    running = found.status
    assert running == RecordingStatus(folder, True, 65.0, 1, {}, ("/tf",))
    with pytest.raises(InputError, match="one is running"):
        found.start("another")
    found.note_replaced(())
    found.note_replaced(("tumour", "tip"))
    ended = found.stop()
    found.note_replaced(("tip",))  # without effect: nothing is recorded
    with (folder / "input").open("rb") as sent:
        values = received_values(sent)
        assert sent.read() == b'{"replaced": ["tumour", "tip"]}\n'
    assert values.tumor is not None and VALUES.tumor is not None
    assert np.array_equal(values.tumor.vertices_mm, VALUES.tumor.vertices_mm)
    assert ended == RecordingStatus(folder, False, 65.0, 7, {"/tf": 2}, ("/tf",))
    assert ended.line == f"recorded in {folder}: 65 s, 7 messages, 2 lost (/tf 2)"
    arguments = (folder / "arguments").read_text()
    assert arguments.startswith(f"-o {folder} --config {tmp_path / 'live.yaml'}")
    assert arguments.endswith("--namespace=room --session-values")
    with pytest.raises(InputError, match="already exists; refusing to overwrite it"):
        found.start()


def test_recording_that_fails_is_reported_and_another_can_begin(tmp_path, monkeypatch):
    found = recorder(tmp_path, monkeypatch, RECORDER.replace("FAILS", FULL_DISK))
    lines: queue.Queue[str] = queue.Queue()
    found.ended = lines.put
    folder = found.start("first")
    line = lines.get(timeout=60.0)
    assert line == (
        f"recorded in {folder}: 65 s, 1 messages, 0 lost; "
        "tracking_0.mcap cannot be written: No space left"
    )
    status = found.status
    assert status is not None and not status.active
    with pytest.raises(InputError, match="none is running"):
        found.stop()
    assert found.start("second").name == "second"
    assert lines.get(timeout=60.0).endswith("No space left")


def test_recorder_that_cannot_begin_is_refused_with_its_reason(tmp_path, monkeypatch):
    found = recorder(tmp_path, monkeypatch, REFUSED)
    with pytest.raises(InputError, match=r"^recording: live\.yaml: no such file$"):
        found.start()
    status = found.status
    assert status is None or not status.active
    assert list((tmp_path / "cases").iterdir()) == []


@pytest.mark.parametrize("name", ["../up", "/etc", "a/b", ".hidden", "a" * 65, "a\nb", "-o"])
def test_name_that_is_not_that_of_a_folder_is_refused(tmp_path, monkeypatch, name):
    found = recorder(tmp_path, monkeypatch, REFUSED)
    with pytest.raises(InputError, match=r"name of a recording: .* expected at most 64 letters"):
        found.start(name)
    assert not (tmp_path / "cases").exists()


def test_folder_that_cannot_be_made_is_refused(tmp_path, monkeypatch):
    (tmp_path / "cases").write_text("a file")
    with pytest.raises(InputError, match=r"cases cannot be written: .* expected a folder"):
        recorder(tmp_path, monkeypatch, REFUSED).start()
