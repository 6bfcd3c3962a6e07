import json
import os
from pathlib import Path

import pytest

from app.report import REPORT_FILES, ReportError, check_writable, write_report
from app.report import write as write_module

SCENE = b"\x89PNG scene"


def names(folder):
    return {path.name for path in folder.iterdir()}


def test_writes_every_file(tmp_path, record_of):
    folder = tmp_path / "new" / "report"
    summary = write_report(folder, record_of([6.0, -1.0]), scene_png=lambda: SCENE, version="1")
    assert names(folder) == set(REPORT_FILES)
    assert json.loads((folder / "summary.json").read_text()) == summary
    assert (folder / "scene.png").read_bytes() == SCENE
    assert (folder / "margin.png").read_bytes().startswith(b"\x89PNG")
    assert len((folder / "margin.csv").read_text().splitlines()) == 3


def test_timing_changes_only_the_summary_and_the_page(tmp_path, record_of):
    for name, durations in (("slow", (9000, 9000)), ("fast", (1, 2))):
        record = record_of([6.0, -1.0], durations_ns=durations)
        write_report(tmp_path / name, record, scene_png=lambda: None, version="1")
    for file in ("margin.csv", "margin.png"):
        assert (tmp_path / "slow" / file).read_bytes() == (tmp_path / "fast" / file).read_bytes()
    slow, fast = (
        json.loads((tmp_path / name / "summary.json").read_text()) for name in ("slow", "fast")
    )
    assert slow.pop("timing") != fast.pop("timing")
    assert slow == fast


def test_replaces_its_own_files_and_leaves_others(tmp_path, record_of):
    (tmp_path / "notes.txt").write_text("mine")
    write_report(tmp_path, record_of([6.0]), scene_png=lambda: SCENE, version="1")
    write_report(tmp_path, record_of([6.0, 7.0]), scene_png=lambda: None, version="1")
    # The second replay has no picture: the one of the first is removed.
    assert names(tmp_path) == {"notes.txt", *REPORT_FILES} - {"scene.png"}
    assert json.loads((tmp_path / "summary.json").read_text())["frames"] == 2
    assert (tmp_path / "notes.txt").read_text() == "mine"


def test_failure_leaves_the_earlier_report(tmp_path, record_of, monkeypatch):
    write_report(tmp_path, record_of([6.0]), scene_png=lambda: SCENE, version="1")
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}

    def disk_full(self, data):
        if self.name == "report.html":
            raise OSError(28, "No space left on device")
        return original(self, data)

    original = Path.write_bytes
    monkeypatch.setattr(write_module.Path, "write_bytes", disk_full)
    with pytest.raises(ReportError, match="No space left on device"):
        write_report(tmp_path, record_of([6.0, 7.0]), scene_png=lambda: None, version="1")
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before


def test_replay_without_frames_is_refused(tmp_path, record_of):
    with pytest.raises(ReportError, match="'three frames': 0 frames; expected at least 1"):
        write_report(tmp_path / "report", record_of([]), scene_png=lambda: None, version="1")
    assert names(tmp_path) == set()


def test_check_leaves_nothing_behind(tmp_path):
    check_writable(tmp_path / "a" / "b")
    check_writable(tmp_path)
    assert names(tmp_path) == set()


def test_relative_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    check_writable(Path("report"))
    assert names(tmp_path) == set()


def test_file_with_the_name_of_the_folder_is_refused(tmp_path):
    (tmp_path / "file").write_text("")
    for folder in (tmp_path / "file", tmp_path / "file" / "report"):
        with pytest.raises(ReportError, match="file is a file; expected a folder") as caught:
            check_writable(folder)
        assert "\n" not in str(caught.value)


def test_broken_link_is_refused(tmp_path):
    (tmp_path / "link").symlink_to(tmp_path / "gone")
    with pytest.raises(ReportError, match="broken link; expected a folder"):
        check_writable(tmp_path / "link")


def test_folder_with_the_name_of_a_report_file_is_refused(tmp_path):
    (tmp_path / "summary.json").mkdir()
    with pytest.raises(ReportError, match=r"summary\.json in it is a folder"):
        check_writable(tmp_path)


def test_unwritable_folder_is_one_line():
    # A system folder that not even root can write to.
    folder = Path("/proc/report")
    if not folder.parent.is_dir() or os.name != "posix":
        pytest.skip("no /proc on this system")
    with pytest.raises(ReportError, match="report folder /proc/report cannot be written") as caught:
        check_writable(folder)
    assert "\n" not in str(caught.value)
