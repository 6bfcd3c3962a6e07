"""Child processes: answers, and errors of those that do not start or do not end."""

import json
import sys

import pytest

from app.files.child_process import ChildError, ask, reported_error, run_to_end

pytestmark = pytest.mark.slow

ANSWERING = """
import os, sys
from app.files.child_process import answer_request
def parts(stream):
    yield stream.read()
    print("printed by a library")
    os.system("echo printed by a process")
    yield b"second"
answer_request(parts)
"""


@pytest.fixture
def module(tmp_path, monkeypatch):
    """``module(code)``: the name of a module that only this process can import."""
    monkeypatch.syspath_prepend(tmp_path)

    def write(code):
        (tmp_path / "answering.py").write_text(code)
        return "answering"

    return write


def test_answer_is_not_mixed_with_prints(module):
    assert ask(module(ANSWERING), b"first ", max_s=60.0) == (0, b"first second")


def test_module_of_the_current_folder_replaces_no_import(module, tmp_path, monkeypatch):
    (tmp_path / "here").mkdir()
    (tmp_path / "here" / "app.py").write_text("raise SystemExit(3)")
    monkeypatch.chdir(tmp_path / "here")
    assert ask(module(ANSWERING), b"", max_s=60.0) == (0, b"second")


def test_variables_reach_the_process(module):
    code = "import os; print(os.environ['ADDED'])"
    assert ask(module(code), b"", max_s=60.0, ADDED="value") == (0, b"value\n")


def test_status_and_both_outputs_are_returned():
    code = "import sys; print('out'); print('error', file=sys.stderr); sys.exit(3)"
    done = run_to_end([sys.executable, "-c", code], 60.0)
    assert (done.returncode, done.stdout, done.stderr) == (3, b"out\n", b"error\n")


def test_process_that_does_not_end_is_an_error():
    with pytest.raises(ChildError, match=r"^did not answer within 0.1 s$"):
        run_to_end(["sleep", "60"], 0.1)


def test_program_that_does_not_exist_is_an_error(tmp_path):
    with pytest.raises(ChildError, match=r"^cannot be started: No such file or directory$"):
        run_to_end([str(tmp_path / "none")], 60.0)


def test_reported_error_is_one_line():
    line = json.dumps({"error": {"message": "a.yaml:\nno such file", "exit_status": 2}}).encode()
    assert reported_error(line) == "a.yaml: no such file"


@pytest.mark.parametrize("line", [b"", b"[INFO] text", b"[1]", b'{"error": 1}', b"3", b"\xff"])
def test_other_lines_report_no_error(line):
    assert reported_error(line) == ""
