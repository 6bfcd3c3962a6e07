"""``marginguard init``: each file that it writes opens; one that does not is not left."""

import io

import pytest
import yaml

from app.case import DOCUMENTS, IgtlSourceEntry, TfSourceEntry, open_case, open_live
from app.files.document_text import commented_yaml
from app.files.keys import Block
from tests.case.images.ultrasound_case import write_ultrasound_case
from tests.cli.command import TerminalDouble, refused, run
from tests.schema_agreement import validator

BODIES = (
    "--tool-frame", "rod", "--tool-mesh", "rod.stl", "--tool-tip", "identity",
    "--tumor-frame", "needle", "--tumor-mesh", "tumor.stl", "--tumor-pose", "identity",
)  # fmt: skip
RECORDING = ("--recording", "tracking.igs.mha")
IMAGES = ("--images-probe", "probe", "--images-calibration", "image_to_probe.txt")


@pytest.fixture
def folder(tmp_path):
    """The files of a case, without its case.yaml."""
    found = write_ultrasound_case(tmp_path / "files")
    (found / "case.yaml").unlink()
    return found


def new_case(folder, *options):
    run("init", "case", folder, *BODIES, *RECORDING, *options)
    return open_case(folder)


def new_live(folder, *options):
    run("init", "live", folder, *BODIES, *options)
    return open_live(folder / "live.yaml")


def test_case_opens_and_has_a_comment_for_each_key(folder):
    manifest = new_case(folder, *IMAGES, "--name", "a: #1").manifest
    assert (manifest.name, manifest.tool.frame) == ("a: #1", "rod")
    assert manifest.images is not None
    text = (folder / "case.yaml").read_text()
    for name in ("registration", "robot", "frozen_after_ms", "sha256", "plausibility"):
        assert f"# {name}:" in text
    assert max(map(len, text.splitlines())) <= 100
    assert validator("case").is_valid(yaml.safe_load(text))


@pytest.mark.parametrize(
    ("options", "source"),
    [
        (("--source", "tf"), TfSourceEntry(())),
        (("--source", "igtl", "--igtl", "plus:18944", *IMAGES), IgtlSourceEntry("plus", 18944)),
        (("--clock", "estimate", *IMAGES, "--images-topic", "/us/image"), None),
    ],
)
def test_live_file_opens(folder, options, source):
    live = new_live(folder, *options, "--stop-mm", "2")
    assert source is None or live.source == source
    assert live.case.manifest.margins.stop_mm == 2.0
    assert (live.case.manifest.images is None) == ("--images-probe" not in options)
    assert validator("live").is_valid(yaml.safe_load((folder / "live.yaml").read_text()))


def test_needle_is_written_with_its_direction(folder):
    needle = ("--needle-frame", "needle", "--needle-length-mm", "60")
    found = new_case(folder, *needle, "--needle-direction", "0", "3", "-4").manifest.items["needle"]
    assert found is not None and found.model is None
    assert (found.frame, found.length_mm, found.direction) == ("needle", 60.0, (0.0, 0.6, -0.8))


@pytest.mark.parametrize("tip_mm", [None, [2.0, 3.0, 120.0]])
def test_stylus_is_written_with_and_without_its_tip(folder, tip_mm):
    tip_file = folder / "pointer.txt"
    tip_file.write_text("1 0 0 2\n0 1 0 3\n0 0 1 120\n0 0 0 1\n")
    options = ["--stylus-frame", "pointer", *(["--stylus-tip", tip_file] if tip_mm else [])]
    found = new_live(folder, "--source", "tf", *options).case.manifest.items["stylus"]
    assert found is not None and found.frame == "pointer"
    tip = found.frame_from_tip
    assert (None if tip is None else tip.translation_mm.tolist()) == tip_mm


def test_poses_are_read_from_files_and_meshes_elsewhere_are_absolute(folder, tmp_path):
    tip = tmp_path / "tip.txt"
    tip.write_text("1 0 0 4 0 1 0 5 0 0 1 6 0 0 0 1")
    mesh = (folder / "rod.stl").rename(tmp_path / "rod.stl")
    tool = new_case(folder, "--tool-mesh", mesh, "--tool-tip", tip).manifest.tool
    assert tool.tool_from_tip.translation_mm.tolist() == [4.0, 5.0, 6.0]
    assert tool.mesh is not None and tool.mesh.path == str(mesh)


NEEDLE, STYLUS = "--needle-frame needle --needle-length-mm", "--stylus-frame"


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ("--tool-mesh none.stl", "none.stl"),
        ("--tumor-frame rod", "tumor.frame is 'rod', the frame of the tool"),
        ("--warn-mm 0.5", "warn_mm is 0.5"),
        ("--recording rod.stl", "rod.stl"),
        ("--needle-frame needle", "--needle-length-mm is missing; expected it for a needle"),
        ("--needle-length-mm 60", "--needle-frame is missing; expected it for a needle"),
        ("--needle-frame rod --needle-length-mm 60", "needle.frame is 'rod', the frame of the to"),
        (f"{NEEDLE} 0.5", "needle.length_mm is 0.5; expected"),
        (f"{NEEDLE} 60 --needle-model no.stl", "no.stl"),
        ("--stylus-tip identity", "--stylus-frame is missing; expected it for a stylus"),
        (
            f"{STYLUS} pointer --stylus-tip identity",
            "stylus.tip_from is 0 mm from the sensor's origin; expected 1 mm or more",
        ),
        (
            f"{STYLUS} rod",
            "stylus.frame is 'rod', the frame of the tool; expected that of a sensor on the stylus",
        ),
        ("--images-probe rdo", "--images-calibration is missing; expected it, or a terminal"),
        ("--tool-tip none.txt", "none.txt"),
        ("--tool-frame ", "--tool-frame is missing"),
    ],
)
def test_file_that_cannot_be_opened_is_not_left(folder, change, expected, monkeypatch):
    monkeypatch.setattr("sys.stdin", io.StringIO())
    assert expected in refused("init", "case", folder, *BODIES, *RECORDING, *change.split(" "))
    assert not (folder / "case.yaml").exists()


def test_existing_file_is_not_overwritten(folder):
    (folder / "live.yaml").write_text("mine")
    error = refused("init", "live", folder, *BODIES, "--source", "tf")
    assert "already exists; refusing to overwrite it" in error
    assert (folder / "live.yaml").read_text() == "mine"


def test_missing_values_are_asked_for_on_a_terminal(folder, monkeypatch):
    answers = ["", "igtl", "", *(each for each in BODIES if not each.startswith("--"))]
    monkeypatch.setattr("sys.stdin", TerminalDouble("\n".join(answers) + "\n"))
    printed = run("init", "live", folder)
    live = open_live(folder / "live.yaml")
    assert live.case.manifest.name == "files"
    assert live.source == IgtlSourceEntry("localhost", 18944)
    assert "Mesh of the tumour: " in printed.err


@pytest.mark.parametrize("document", ["case", "live"])
def test_each_key_of_the_declaration_is_in_the_text(document):
    block = DOCUMENTS[document]
    text = commented_yaml(block, {}, "title")
    assert [name for name in block.keys if f"# {name}:" not in text] == []
    inner = block.keys["margins"]
    assert isinstance(inner, Block)
    text = commented_yaml(block, {"margins": {"stop_mm": 1.0}}, "title")
    for name, key in inner.keys.items():
        assert f"{name}:" in text and key.description.split()[0] in text
    assert "  # release_samples: 3" in text
