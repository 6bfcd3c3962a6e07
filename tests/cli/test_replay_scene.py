"""``--save-scene`` and ``--movie`` with the recorded case of the project."""

import csv
import json
import shutil
import subprocess
import sys
from collections import Counter
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import yaml
from PIL import Image
from pypdf import PdfReader

from app.case import Case, open_case, read_mrml
from app.cli.main import main
from app.files import extras
from app.files.paths import sha256_of
from app.fixture import MarginState
from app.geometry import InputError, Transform
from app.scene import OffscreenError, use_offscreen_rendering
from app.session import Session, StepResult, setup_from_case
from tests import shipped_case
from tests.cli.small_case import write_small_case

ROOT = Path(__file__).resolve().parents[2]
RECORDED = ROOT / "data" / "recorded_case"


def replay(case: Path, *options: str) -> int:
    return main(["replay", str(case), "--no-ros", "--json", *options])


@pytest.fixture(scope="module")
def saved(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("scene") / "deepest.mrb"
    assert replay(RECORDED, "--save-scene", str(path)) == 0
    assert [entry.name for entry in path.parent.iterdir()] == [path.name]
    return path


@pytest.fixture(scope="module")
def loaded(saved: Path) -> dict[str, Any]:
    """The content of the file, as another process loads it."""
    done = subprocess.run(
        [sys.executable, "-m", "tests.scene.scene_content", str(saved)],
        capture_output=True,
        text=True,
        check=True,
        cwd=ROOT,
    )
    found: dict[str, Any] = json.loads(done.stdout)
    return found


@pytest.fixture(scope="module")
def case() -> Case:
    return open_case(RECORDED)


@pytest.fixture(scope="module")
def deepest(case: Case) -> StepResult:
    """The step of the frame with the smallest distance of the whole replay."""
    session = Session(setup_from_case(case, tip_only=False))
    steps = [step for step in map(session.step, case.frames()) if step.decision.proximity]
    return min(steps, key=distance_mm)


def distance_mm(step: StepResult) -> float:
    assert step.decision.proximity is not None
    return step.decision.proximity.signed_distance_mm


def test_every_pose_of_the_case_is_in_the_scene(
    loaded: dict[str, Any], case: Case, deepest: StepResult
) -> None:
    """Compare with matrix products of recording, manifest and kinematics, independent of MRML."""
    measured = {pose.source: pose.transform.matrix for pose in deepest.frame.poses}  # type: ignore[union-attr]
    reference = np.linalg.inv(measured["reference"])
    setup = setup_from_case(case, tip_only=False)
    fixed: dict[str, Transform] = {edge.source: edge for edge in setup.static_edges}
    expected = {
        "ReferenceToRas": np.eye(4),
        "TrackerToReference": reference,
        "NeedleToReference": reference @ measured["needle"],
        "CauteryToReference": reference @ measured["cautery"],
        "TumorToNeedle": reference @ measured["needle"] @ fixed["tumor"].matrix,
        "CauteryTipToCautery": reference @ measured["cautery"] @ fixed["cautery_tip"].matrix,
        "RobotBaseToReference": fixed["robot_base"].matrix,
    }
    for name, pose in deepest.links.items():
        if name != "touch_base":
            camel = "".join(word.capitalize() for word in name.split("_"))
            expected[f"{camel}ToTouchBase"] = fixed["robot_base"].matrix @ pose.matrix
    for name, matrix in expected.items():
        found = np.reshape(loaded[name]["to_world"], (4, 4))
        np.testing.assert_allclose(found, matrix, rtol=0, atol=1e-9, err_msg=name)
    assert len(expected) >= 12
    transforms = {n for n, v in loaded.items() if v["class"] == "vtkMRMLLinearTransformNode"}
    assert transforms == {*expected, "TouchBaseToRobotBase"}


def test_every_surface_and_colour_of_the_case_is_in_the_scene(
    loaded: dict[str, Any], case: Case, deepest: StepResult
) -> None:
    for name, mesh in (("Tumor", case.tumor_mesh()), ("Tool", case.tool_mesh())):
        found = {tuple(np.round(point, 4)) for point in loaded[name]["points"]}
        assert found == {tuple(np.round(point, 4)) for point in mesh.vertices_mm.tolist()}
        assert len(loaded[name]["triangles"]) == 3 * len(mesh.faces)
    assert loaded["Tumor"]["display"]["color"] == list(MarginState.POSITIVE.color)
    assert loaded["Tumor"]["display"]["opacity"] == 0.4
    assert loaded["stylus_model"]["display"]["opacity"] == 0.35  # the tool inside stays visible
    proximity = deepest.decision.proximity
    assert proximity is not None
    distance = f"{proximity.signed_distance_mm:.1f} mm"
    assert loaded["MarginStatus"]["text"] == f"POSITIVE: in the tumour, {distance}"
    ends = np.array([point[:3] for point in loaded["ClosestPoints"]["points"]])
    np.testing.assert_allclose(
        np.linalg.norm(ends[1] - ends[0]), abs(proximity.signed_distance_mm), atol=1e-6
    )
    assert loaded["ClosestPoints"]["points"][0][3] == distance
    colors = loaded["torso_model"]["cell_colors"]
    assert len(Counter(map(tuple, colors))) >= 2


def without_robot(case: Path, recording: str) -> Path:
    """The case without its robot, because a scene has no joints."""
    manifest = yaml.safe_load((RECORDED / "case.yaml").read_text())
    for key in ("robot", "registration", "expected"):
        del manifest[key]
    manifest["recording"] = {"path": recording}
    (case / "case.yaml").write_text(yaml.safe_dump(manifest))
    return case


def test_saved_scene_replays_like_its_recording(saved: Path, tmp_path: Path) -> None:
    case = tmp_path / "case"
    shutil.copytree(RECORDED, case)
    shutil.copyfile(saved, case / "x.mrb")
    steps = []
    for recording in ("tracking.mcap", "x.mrb"):
        opened = open_case(without_robot(case, recording))
        session = Session(setup_from_case(opened, tip_only=False))
        steps.append([session.step(frame) for frame in opened.frames()])
        assert opened.notes() == ()
    of_mcap, of_scene = steps
    assert len(of_scene) == shipped_case.FRAMES
    for expected, found in zip(of_mcap, of_scene, strict=True):
        assert expected.frame.stamp == found.frame.stamp
        edges = [
            {(pose.target, pose.source): pose.status for pose in step.frame.poses}
            for step in (expected, found)
        ]
        assert edges[0] == edges[1]
        assert expected.decision.state is found.decision.state
        known, proximity = expected.decision.proximity, found.decision.proximity
        assert (proximity is None) == (known is None)
        if proximity is not None and known is not None:
            # MRML has six digits per number: 0.0005 mm in two positions, 1e-6 rad in two rotations.
            distance_mm = pytest.approx(known.signed_distance_mm, abs=0.01)
            assert proximity.signed_distance_mm == distance_mm


def test_case_with_a_scene_as_recording_refuses_joints(
    saved: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    case = tmp_path / "case"
    shutil.copytree(RECORDED, case)
    shutil.copyfile(saved, case / "x.mrb")
    manifest = yaml.safe_load((case / "case.yaml").read_text())
    manifest["recording"] = {"path": "x.mrb"}
    (case / "case.yaml").write_text(yaml.safe_dump(manifest))
    assert replay(case) == 2
    assert "robot.joint_states is given: x.mrb cannot hold joints" in capsys.readouterr().err


def test_scene_movie_and_report_of_a_small_case(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    try:
        use_offscreen_rendering()
    except OffscreenError as error:
        pytest.skip(str(error))
    case = write_small_case(tmp_path / "case")
    out, mrb, gif = tmp_path / "out", tmp_path / "s.mrb", tmp_path / "m.gif"
    options = ["--report", str(out), "--save-scene", str(mrb), "--movie", str(gif)]
    options += ["--pdf", str(tmp_path / "report.pdf")]
    assert replay(case, *options, "--movie-seconds", "1") == 0
    pages = PdfReader(tmp_path / "report.pdf").pages
    text = "\n".join(page.extract_text() for page in pages)
    assert sha256_of(case / "tracking.igs.mha") in text
    scene = Image.open(out / "scene.png")
    assert scene.size in {each.image.size for page in pages for each in page.images}
    summary = json.loads(capsys.readouterr().out)
    assert summary["frames"] == 40
    assert (out / "scene.png").read_bytes().startswith(b"\x89PNG")
    assert len(list(read_mrml(mrb, print))) == 40
    movie = Image.open(gif)
    assert movie.n_frames == 12
    rows = list(csv.DictReader((out / "margin.csv").open()))
    states = [MarginState[row["state"]] for row in rows]
    assert len(set(states)) > 2
    for number in range(movie.n_frames):
        worst = max(states[40 * number // 12 : 40 * (number + 1) // 12])
        movie.seek(number)
        level = movie.convert("RGB").getpixel((movie.width - 2, 2))
        assert level == tuple(round(255 * part) for part in worst.color)


def test_video_of_a_small_case(tmp_path: Path) -> None:
    pytest.importorskip("av", reason="the extra video is not installed")
    try:
        use_offscreen_rendering()
    except OffscreenError as error:
        pytest.skip(str(error))
    case, movie = write_small_case(tmp_path / "case"), tmp_path / "m.MP4"
    assert replay(case, "--movie", str(movie), "--movie-seconds", "1") == 0
    video = cv2.VideoCapture(str(movie))
    assert video.get(cv2.CAP_PROP_FRAME_COUNT) == 12
    size = (video.get(cv2.CAP_PROP_FRAME_WIDTH), video.get(cv2.CAP_PROP_FRAME_HEIGHT))
    assert size == (800.0, 450.0)
    video.release()


def test_video_without_its_extra_is_refused_before_the_replay(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    find_spec = extras.find_spec
    monkeypatch.setattr(extras, "find_spec", lambda name: None if name == "av" else find_spec(name))
    case, movie = write_small_case(tmp_path / "case"), tmp_path / "m.mp4"
    assert replay(case, "--movie", str(movie)) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert "av is not installed: run `pip install" in error and "write the movie as .gif" in error
    assert not movie.exists()


def test_clock_that_jumps_back_leaves_a_scene_without_recording(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    case, mrb = write_small_case(tmp_path / "case"), tmp_path / "s.mrb"
    recording = case / "tracking.igs.mha"
    text = recording.read_text().replace("Frame0039_Timestamp = 101.950", "Frame0039_Timestamp = 5")
    recording.write_text(text)
    assert replay(case, "--save-scene", str(mrb)) == 0
    error = capfd.readouterr().err
    assert error.count("\n") == 1
    assert "without the recording: recording: a frame at 5.000000000 s comes after" in error
    with pytest.raises(InputError, match="no sequence of transforms"):
        list(read_mrml(mrb, print))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (
            ["--movie", "replay.avi"],
            "'replay.avi'; expected a file name that ends with .gif or .mp4",
        ),
        (["--save-scene", "scene.mrml"], "'scene.mrml'; expected a file name that ends with .mrb"),
        (["--movie", "m.gif", "--movie-seconds", "0"], "0 s; expected 1 to 60 s"),
    ],
)
def test_invalid_options_are_refused(
    options: list[str], message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as stop:
        replay(tmp_path, *options)
    assert stop.value.code == 2
    assert message in capsys.readouterr().err


def test_missing_folder_is_reported_before_the_replay(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    case = write_small_case(tmp_path / "case")
    assert replay(case, "--pdf", str(tmp_path / "none" / "r.pdf")) == 2
    assert "parent directory does not exist" in capsys.readouterr().err
    assert replay(case, "--movie", str(tmp_path / "none" / "m.gif")) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert "parent directory does not exist" in error
    assert replay(case, "--rate", "1", "--loop", "--movie", str(tmp_path / "m.gif")) == 2
    assert "--loop: without --rate or with an output file; expected" in capsys.readouterr().err
