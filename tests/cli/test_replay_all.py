"""``marginguard replay --report DIR --all``: all results of one replay in one folder."""

import json
from pathlib import Path

import pyarrow.parquet as pq
import pydicom
import pytest
import trimesh
from mcap.reader import make_reader
from pypdf import PdfReader
from rosbags.rosbag2 import Reader

from app.cli.bag_writing import BagProcess
from app.cli.complete_report import BAG, DICOM
from app.cli.main import main
from app.dicom.study import SEGMENTATION_FILE, STRUCTURE_SET_FILE
from app.report import ANALYSIS_FILES, REPORT_FILES
from app.report.analysis_files import CSV_FILES
from tests.cli.small_case import FRAMES, write_small_case

PARTS = {"report.pdf", "frames.parquet", *CSV_FILES, DICOM, BAG}


@pytest.fixture(scope="module")
def case(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_small_case(tmp_path_factory.mktemp("all") / "case")


@pytest.fixture(scope="module")
def folder(case: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("all") / "report"
    assert main(["replay", str(case), "--no-ros", "--report", str(folder), "--all"]) == 0
    return folder


def names(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()}


def contents(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def test_everything_is_in_the_folder_and_readable(folder):
    assert names(folder) == {*REPORT_FILES, *ANALYSIS_FILES, *PARTS}
    assert pq.read_table(folder / "frames.parquet").num_rows == FRAMES
    text = "\n".join(page.extract_text() for page in PdfReader(folder / "report.pdf").pages)
    found = json.loads((folder / "analysis.json").read_text())
    assert "Insertion" in text and "tissue damage" in text
    assert f"{found['insertion']['tissue_damage_mm2']:.1f} mm²" in text
    assert pydicom.dcmread(folder / DICOM / SEGMENTATION_FILE).Modality == "SEG"
    assert pydicom.dcmread(folder / DICOM / STRUCTURE_SET_FILE).Modality == "RTSTRUCT"
    with Reader(folder / BAG) as reader:
        counts = {topic: each.msgcount for topic, each in reader.topics.items()}
    assert counts["/marginguard/margin_mm"] == FRAMES


def test_files_are_those_of_the_separate_commands(case, folder, tmp_path):
    report, pdf, bag = tmp_path / "report", tmp_path / "report.pdf", tmp_path / BAG
    files = ["--report", str(report), "--pdf", str(pdf), "--mcap", str(bag)]
    assert main(["replay", str(case), "--no-ros", *files]) == 0
    tables, dicom = tmp_path / "tables", tmp_path / DICOM
    options = ["--json", str(tmp_path / "analysis.json"), "--dicom", str(dicom)]
    options += ["--csv", str(tables), "--parquet", str(tables / "frames.parquet")]
    tables.mkdir()
    assert main(["analyse", str(case), *options]) == 0
    together = contents_of_files(folder)
    for name, content in {**contents(report), **contents(tables)}.items():
        if name not in ("summary.json", "report.html"):  # they have the time of a step
            assert together[name] == content, name
    assert together["report.pdf"] == pdf.read_bytes()
    assert together["analysis.json"] == (tmp_path / "analysis.json").read_bytes()
    assert contents(folder / DICOM) == contents(dicom)
    assert messages(folder / BAG) == messages(bag)


def contents_of_files(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()}


def messages(bag: Path) -> list[tuple[str, int, int]]:
    """Topic, time and length of each message; rclpy does not set the bytes between the values."""
    with next(bag.glob("*.mcap")).open("rb") as file:
        return [
            (channel.topic, message.log_time, len(message.data))
            for _, channel, message in make_reader(file).iter_messages()
        ]


def test_a_part_that_fails_is_left_out_with_its_reason(tmp_path, capsys):
    case = write_small_case(tmp_path / "case")
    # So small that its voxels have another volume.
    trimesh.creation.icosphere(subdivisions=2, radius=0.8).export(case / "tumor.stl")
    folder = tmp_path / "report"
    (folder / DICOM).mkdir(parents=True)
    (folder / DICOM / SEGMENTATION_FILE).write_text("of an earlier report")
    (folder / "notes.txt").write_text("kept")
    assert main(["replay", str(case), "--no-ros", "--report", str(folder), "--all"]) == 2
    lines = [line for line in capsys.readouterr().err.splitlines() if line.startswith("no ")]
    assert len(lines) == 1
    assert lines[0].startswith("no dicom: structure 'tumor'")
    expected = {*REPORT_FILES, *ANALYSIS_FILES, *PARTS, "notes.txt"} - {DICOM}
    assert names(folder) == expected


def test_a_bag_whose_process_ends_is_left_out(case, tmp_path, capsys, monkeypatch):
    begin = BagProcess.begin

    def begin_and_kill(self: BagProcess, run: object, folder: Path) -> None:
        begin(self, run, folder)
        self._process.kill()

    monkeypatch.setattr(BagProcess, "begin", begin_and_kill)
    folder = tmp_path / "report"
    assert main(["replay", str(case), "--no-ros", "--report", str(folder), "--all"]) == 2
    assert "no results: bag: the process that writes it ended" in capsys.readouterr().err
    assert names(folder) == {*REPORT_FILES, *ANALYSIS_FILES, *PARTS} - {BAG}


def test_a_replay_that_fails_leaves_nothing(case, tmp_path, capsys, monkeypatch):
    from app.report import ReplayLog

    def fail(self: ReplayLog, step: object, timing: object) -> bool:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(ReplayLog, "publish", fail)
    folder = tmp_path / "report"
    assert main(["replay", str(case), "--no-ros", "--report", str(folder), "--all"]) == 2
    assert "No space left on device" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_a_folder_with_other_files_is_not_replaced(case, tmp_path, capsys):
    (tmp_path / DICOM).mkdir()
    (tmp_path / DICOM / "patient.dcm").write_text("kept")
    assert main(["replay", str(case), "--no-ros", "--report", str(tmp_path), "--all"]) == 2
    assert "dicom in it is not of a report" in capsys.readouterr().err
    assert (tmp_path / DICOM / "patient.dcm").read_text() == "kept"
    assert names(tmp_path) == {DICOM}


@pytest.mark.parametrize("options", [["--all"], ["--all", "--report", "r", "--mcap", "m"]])
def test_all_needs_a_report_and_no_other_bag(case, tmp_path, capsys, monkeypatch, options):
    monkeypatch.chdir(tmp_path)
    assert main(["replay", str(case), "--no-ros", *options]) == 2
    assert "--all: without --report or with --mcap" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []
