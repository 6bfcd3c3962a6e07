import json
import os
from pathlib import Path

import pytest

from app.fixture import Reason
from app.report import REPORT_FILES, ReportError, check_writable, summarise
from app.report import write as write_module
from app.report.rows import COLUMNS
from app.report.write import ANALYSIS_FILES
from tests.report.conftest import write

pytestmark = pytest.mark.slow

SCENE = b"\x89PNG scene"


def names(folder):
    return {path.name for path in folder.iterdir()}


def test_writes_every_file(tmp_path, record_of):
    folder = tmp_path / "new" / "report"
    summary = write(folder, record_of([6.0, -1.0]), SCENE, margin_plot=None)
    assert names(folder) == set(REPORT_FILES)
    assert json.loads((folder / "summary.json").read_text()) == summary
    assert (folder / "scene.png").read_bytes() == SCENE
    assert (folder / "margin.png").read_bytes().startswith(b"\x89PNG")
    assert len((folder / "margin.csv").read_text().splitlines()) == 3


def test_timing_changes_only_the_summary_and_the_page(tmp_path, record_of):
    summaries = []
    for name, durations in (("slow", (9000, 9000)), ("fast", (1, 2))):
        record = record_of([6.0, -1.0], durations_ns=durations)
        write(tmp_path / name, record, margin_plot=None)
        summaries.append(json.loads((tmp_path / name / "summary.json").read_text()))
    for file in ("margin.csv", "margin.png"):
        assert (tmp_path / "slow" / file).read_bytes() == (tmp_path / "fast" / file).read_bytes()
    slow, fast = summaries
    assert slow.pop("timing") != fast.pop("timing")
    assert slow == fast


def test_replaces_its_own_files_and_leaves_others(tmp_path, record_of, analysed):
    (tmp_path / "notes.txt").write_text("mine")
    write(tmp_path, record_of([6.0]), SCENE, analysed=analysed)
    assert names(tmp_path) == {"notes.txt", *REPORT_FILES, *ANALYSIS_FILES}
    write(tmp_path, record_of([6.0, 7.0]))
    # The second replay has no picture and no analysis: those of the first are removed.
    assert names(tmp_path) == {"notes.txt", *REPORT_FILES} - {"scene.png"}
    assert json.loads((tmp_path / "summary.json").read_text())["frames"] == 2
    assert (tmp_path / "notes.txt").read_text() == "mine"


def test_failure_leaves_the_earlier_report(tmp_path, record_of, monkeypatch):
    write(tmp_path, record_of([6.0]), SCENE)
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}

    def disk_full(self, data):
        if self.name == "report.html":
            raise OSError(28, "No space left on device")
        return original(self, data)

    original = Path.write_bytes
    monkeypatch.setattr(write_module.Path, "write_bytes", disk_full)
    with pytest.raises(ReportError, match="No space left on device"):
        write(tmp_path, record_of([6.0, 7.0]))
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before


def test_replay_without_frames_is_refused(tmp_path, record_of):
    with pytest.raises(ReportError, match="'three frames': 0 frames; expected at least 1"):
        write(tmp_path / "report", record_of([]))
    assert names(tmp_path) == set()


def test_check_leaves_nothing_behind(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for folder in (tmp_path / "a" / "b", tmp_path, Path("report")):
        check_writable(folder)
        assert names(tmp_path) == set()


@pytest.mark.parametrize(
    ("prepare", "folder", "problem"),
    [
        (lambda path: (path / "file").write_text(""), "file", "file is a file; expected a folder"),
        (lambda path: (path / "file").write_text(""), "file/report", "file is a file; expected a "),
        (lambda path: (path / "link").symlink_to(path / "gone"), "link", "broken link; expected a"),
        (lambda path: (path / "summary.json").mkdir(), ".", r"summary\.json in it is a folder"),
    ],
    ids=["file", "below a file", "broken link", "folder with the name of a file"],
)
def test_folder_that_cannot_be_one_is_refused_in_one_line(tmp_path, prepare, folder, problem):
    prepare(tmp_path)
    with pytest.raises(ReportError, match=problem) as caught:
        check_writable(tmp_path / folder)
    assert "\n" not in str(caught.value)


def test_unwritable_folder_is_one_line():
    # A system folder that not even root can write to.
    folder = Path("/proc/report")
    if not folder.parent.is_dir() or os.name != "posix":
        pytest.skip("no /proc on this system")
    with pytest.raises(ReportError, match="report folder /proc/report cannot be written") as caught:
        check_writable(folder)
    assert "\n" not in str(caught.value)


def test_every_file_column_key_and_reason_is_explained(project_root, record_of):
    page = (project_root / "docs/report.md").read_text(encoding="utf-8")
    names = {
        *REPORT_FILES,
        *ANALYSIS_FILES,
        *COLUMNS,
        *map(str, Reason),
        *summarise(record_of([8.0, -1.0])),
    }
    assert {name for name in names if f"`{name}`" not in page} == set()
