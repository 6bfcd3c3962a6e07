"""``marginguard replay --report DIR --all``: all results of one replay, with scene and movie."""

import csv
import json

import pyarrow.parquet as pq
import pydicom
import pytest
import trimesh
from mcap.reader import make_reader
from PIL import Image
from pypdf import PdfReader
from rosbags.rosbag2 import Reader

from app.case import read_mrml
from app.cli.bag_writing import BagProcess
from app.cli.complete_report import BAG, DICOM
from app.dicom.study import SEGMENTATION_FILE, STRUCTURE_SET_FILE
from app.files.paths import sha256_of
from app.fixture import MarginState
from app.report import ANALYSIS_FILES, REPORT_FILES, ReplayLog
from tests.cli.command import refused, run, run_json
from tests.cli.small_case import FRAMES, write_small_case

pytestmark = pytest.mark.long

TABLES = {f"{name}.csv" for name in ("analysis", "breaches", "coverage", "directions")}
ALL = {*REPORT_FILES, *ANALYSIS_FILES, "report.pdf", "frames.parquet", *TABLES, DICOM, BAG}


@pytest.fixture(scope="module")
def case(tmp_path_factory):
    return write_small_case(tmp_path_factory.mktemp("all") / "case")


@pytest.fixture(scope="module")
def folder(case, tmp_path_factory):
    """The report, beside the scene and the movie of the same replay."""
    folder = tmp_path_factory.mktemp("all") / "report"
    movie = ("--movie", folder.parent / "m.gif", "--movie-seconds", "1")
    scene = ("--save-scene", folder.parent / "s.mrb")
    summary = run_json("replay", case, "--no-ros", "--report", folder, "--all", *scene, *movie)
    assert summary["frames"] == FRAMES
    return folder


@pytest.fixture(scope="module")
def pages(folder):
    return PdfReader(folder / "report.pdf").pages


@pytest.fixture(scope="module")
def text(pages):
    return "\n".join(page.extract_text() for page in pages)


def names(folder):
    return {path.name for path in folder.iterdir()}


def contents(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()}


def test_everything_is_in_the_folder_and_readable(folder, text):
    assert names(folder) == ALL
    assert pq.read_table(folder / "frames.parquet").num_rows == FRAMES
    found = json.loads((folder / "analysis.json").read_text())
    assert "Insertion" in text and "tissue damage" in text
    assert f"{found['insertion']['tissue_damage_mm2']:.1f} mm²" in text
    assert pydicom.dcmread(folder / DICOM / SEGMENTATION_FILE).Modality == "SEG"
    assert pydicom.dcmread(folder / DICOM / STRUCTURE_SET_FILE).Modality == "RTSTRUCT"
    with Reader(folder / BAG) as reader:
        counts = {topic: each.msgcount for topic, each in reader.topics.items()}
    assert counts["/marginguard/margin_mm"] == FRAMES


def test_pdf_names_the_recording_and_shows_the_scene(case, folder, pages, text):
    assert sha256_of(case / "tracking.igs.mha") in text
    scene = Image.open(folder / "scene.png")
    assert scene.format == "PNG"
    assert any(each.image.size == scene.size for page in pages for each in page.images)


def test_saved_scene_has_every_frame(folder):
    assert len(list(read_mrml(folder.parent / "s.mrb", print))) == FRAMES


def test_movie_shows_the_worst_state_of_its_frames(folder):
    movie = Image.open(folder.parent / "m.gif")
    assert movie.n_frames == 12
    with (folder / "margin.csv").open() as file:
        states = [MarginState[row["state"]] for row in csv.DictReader(file)]
    assert len(set(states)) > 2
    for number in range(movie.n_frames):
        worst = max(states[FRAMES * number // 12 : FRAMES * (number + 1) // 12])
        movie.seek(number)
        level = movie.convert("RGB").getpixel((movie.width - 2, 2))
        assert level == tuple(round(255 * part) for part in worst.color)


def test_files_are_those_of_the_separate_commands(case, folder, tmp_path):
    report, pdf, bag = tmp_path / "report", tmp_path / "report.pdf", tmp_path / BAG
    run("replay", case, "--no-ros", "--report", report, "--pdf", pdf, "--mcap", bag)
    tables, dicom = tmp_path / "tables", tmp_path / DICOM
    tables.mkdir()
    files = ("--csv", tables, "--parquet", tables / "frames.parquet", "--dicom", dicom)
    run("analyse", case, "--json", tmp_path / "analysis.json", *files)
    together = contents(folder)
    for name, content in {**contents(report), **contents(tables), **contents(tmp_path)}.items():
        if name not in ("summary.json", "report.html"):  # they have the time of a step
            assert together[name] == content, name
    assert {"report.pdf", "analysis.json"} < names(tmp_path)
    assert contents(folder / DICOM) == contents(dicom)
    assert messages(folder / BAG) == messages(bag)


def messages(bag):
    """Topic, time and length of each message; rclpy does not set the bytes between the values."""
    with next(bag.glob("*.mcap")).open("rb") as file:
        return [
            (channel.topic, message.log_time, len(message.data))
            for _, channel, message in make_reader(file).iter_messages()
        ]


def test_parts_that_fail_are_left_out_with_their_reasons(tmp_path, monkeypatch, without_scene):
    case, folder = write_small_case(tmp_path / "case"), tmp_path / "report"
    # So small that its voxels have another volume.
    trimesh.creation.icosphere(subdivisions=2, radius=0.8).export(case / "tumor.stl")
    (folder / DICOM).mkdir(parents=True)
    (folder / DICOM / SEGMENTATION_FILE).write_text("of an earlier report")
    (folder / "notes.txt").write_text("kept")
    begin = BagProcess.begin

    def begin_and_kill(self, run, folder):
        begin(self, run, folder)
        self._process.kill()

    monkeypatch.setattr(BagProcess, "begin", begin_and_kill)
    printed = run("replay", case, "--no-ros", "--report", folder, "--all", status=2)
    dicom, bag, scene = sorted(line for line in printed.err.splitlines() if line.startswith("no "))
    assert dicom.startswith("no dicom: structure 'tumor'")
    assert "no results: bag: the process that writes it ended" in bag
    assert scene.startswith("no scene.png: ") and "no slicer here" in scene
    assert names(folder) == {*ALL, "notes.txt"} - {DICOM, BAG, "scene.png"}


def test_a_replay_that_fails_leaves_nothing(case, tmp_path, monkeypatch):
    def fail(self, step, timing):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(ReplayLog, "publish", fail)
    printed = run("replay", case, "--no-ros", "--report", tmp_path / "report", "--all", status=2)
    assert "No space left on device" in printed.err
    assert list(tmp_path.iterdir()) == []


def test_a_folder_with_other_files_is_not_replaced(case, tmp_path):
    (tmp_path / DICOM).mkdir()
    (tmp_path / DICOM / "patient.dcm").write_text("kept")
    error = refused("replay", case, "--no-ros", "--report", tmp_path, "--all")
    assert "dicom in it is not of a report" in error
    assert (tmp_path / DICOM / "patient.dcm").read_text() == "kept"
    assert names(tmp_path) == {DICOM}


@pytest.mark.parametrize("options", [["--all"], ["--all", "--report", "r", "--mcap", "m"]])
def test_all_needs_a_report_and_no_other_bag(case, tmp_path, monkeypatch, options):
    monkeypatch.chdir(tmp_path)
    error = refused("replay", case, "--no-ros", *options)
    assert "--all: without --report or with --mcap" in error
    assert list(tmp_path.iterdir()) == []
