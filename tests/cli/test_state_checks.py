"""`marginguard doctor` on the folder of the holds, which `doctor clean` does not touch."""

import os
import time

import pytest

from app.cli.installation_checks import check_state
from app.files.paths import state_folder
from app.hold import InstanceKey, live_state
from tests.cli import command

KEY = InstanceKey("host", 7, "/watch", "")


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    return state_folder()


def run(folder, *, held):
    with live_state(folder, KEY, {}, clock_ns=time.time_ns, log=print) as state:
        state.resume()
        state.end(held, ("stale",))


def test_folder_that_does_not_exist_yet_is_fine_and_is_not_made(folder):
    assert check_state(folder) == ("live sessions", True, str(folder), "")
    assert not folder.exists()


def test_hold_and_damaged_record_are_named(folder):
    run(folder, held=True)
    check = check_state(folder)
    assert check.ok
    assert (
        "namespace '/watch' in ROS domain 7: the next session begins on hold (guard" in check.found
    )
    (record,) = folder.glob("*.json")
    record.write_bytes(b"")
    assert "damaged; expected the record of a run: the next session" in check_state(folder).found


def test_running_session_is_named(folder):
    with live_state(folder, KEY, {}, clock_ns=time.time_ns, log=print):
        assert f"a session runs (process {os.getpid()})" in check_state(folder).found


def test_orderly_end_without_hold_is_not_listed(folder):
    run(folder, held=False)
    assert check_state(folder).found == str(folder)


def test_folder_that_cannot_be_written_has_a_remedy(folder):
    folder.parent.mkdir(parents=True, exist_ok=True)
    folder.write_text("")
    check = check_state(folder)
    assert not check.ok
    assert "XDG_STATE_HOME" in check.remedy


def test_clean_leaves_the_hold(folder):
    run(folder, held=True)
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    assert str(folder) not in command.run("doctor", "clean").out
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == before


@pytest.mark.parametrize("given", ["", "relative/path"])
def test_relative_state_home_is_ignored(given, monkeypatch, tmp_path):
    monkeypatch.setenv("HOME", str(tmp_path))
    expected = tmp_path / ".local" / "state" / "marginguard"
    assert state_folder({"XDG_STATE_HOME": given}) == expected
