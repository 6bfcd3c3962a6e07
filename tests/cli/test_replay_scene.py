"""``--save-scene`` and ``--movie``: seconds of the shipped case, and a small case."""

import json
import shutil
from collections import Counter

import cv2
import numpy as np
import pytest

from app.case import open_case, read_mrml
from app.files import extras
from app.fixture import MarginState
from app.geometry import InputError
from app.session import Session, setup_from_case
from tests.cli import command
from tests.cli.small_case import edit_manifest, write_small_case
from tests.cut_case import write_cut_case
from tests.python_process import run_python
from tests.shipped_case import BRIEF

pytestmark = pytest.mark.long


def replay(case, *options):
    return command.run_json("replay", case, "--no-ros", *options)


def refused(case, *options):
    return command.refused("replay", case, "--no-ros", *options)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A breach, and three seconds after it the reference is lost for half a second."""
    folder = tmp_path_factory.mktemp("cut") / "case"
    return write_cut_case(folder, BRIEF["start_s"] - 1.0, 4.6)


@pytest.fixture(scope="module")
def saved(folder, tmp_path_factory):
    path = tmp_path_factory.mktemp("scene") / "deepest.mrb"
    replay(folder, "--save-scene", path)
    assert [entry.name for entry in path.parent.iterdir()] == [path.name]
    return path


PRINT_CONTENT = """
import json, sys
from pathlib import Path
from tests.scene.conftest import loaded
from tests.scene.scene_content import content

print(json.dumps(content(loaded(Path(sys.argv[1])).scene)))
"""


@pytest.fixture(scope="module")
def loaded(saved, project_root):
    """The content of the file, as another process loads it."""
    done = run_python("-c", PRINT_CONTENT, saved, cwd=project_root)
    return json.loads(done.stdout)


@pytest.fixture(scope="module")
def case(folder):
    return open_case(folder)


@pytest.fixture(scope="module")
def deepest(case):
    """The step of the frame with the smallest distance of the whole replay."""
    steps = [step for step in steps_of(case) if step.decision.proximity]
    return min(steps, key=lambda step: step.decision.proximity.signed_distance_mm)


def steps_of(case):
    session = Session(setup_from_case(case, tip_only=False))
    return [session.step(frame) for frame in case.frames()]


def test_every_pose_of_the_case_is_in_the_scene(loaded, case, deepest):
    """Compare with matrix products of recording, manifest and kinematics, independent of MRML."""
    measured = {pose.source: pose.transform.matrix for pose in deepest.frame.poses}
    reference = np.linalg.inv(measured["reference"])
    setup = setup_from_case(case, tip_only=False)
    fixed = {edge.source: edge for edge in setup.static_edges}
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


def test_every_surface_and_colour_of_the_case_is_in_the_scene(loaded, case, deepest):
    for name, mesh in (("Tumor", case.tumor_mesh()), ("Tool", case.tool_mesh())):
        found = {tuple(np.round(point, 4)) for point in loaded[name]["points"]}
        assert found == {tuple(np.round(point, 4)) for point in mesh.vertices_mm.tolist()}
        assert len(loaded[name]["triangles"]) == 3 * len(mesh.faces)
    assert loaded["Tumor"]["display"]["color"] == list(MarginState.POSITIVE.color)
    assert loaded["Tumor"]["display"]["opacity"] == 0.4
    assert loaded["stylus_model"]["display"]["opacity"] == 0.35  # the tool inside stays visible
    signed_mm = deepest.decision.proximity.signed_distance_mm
    distance = f"{signed_mm:.1f} mm"
    assert loaded["MarginStatus"]["text"] == f"POSITIVE: in the tumour, {distance}"
    ends = np.array([point[:3] for point in loaded["ClosestPoints"]["points"]])
    np.testing.assert_allclose(np.linalg.norm(ends[1] - ends[0]), abs(signed_mm), atol=1e-6)
    assert loaded["ClosestPoints"]["points"][0][3] == distance
    colors = loaded["torso_model"]["cell_colors"]
    assert len(Counter(map(tuple, colors))) >= 2


def recorded_by(folder, saved, copy):
    """A copy of the case whose recording is the saved scene."""
    shutil.copytree(folder, copy)
    shutil.copyfile(saved, copy / "x.mrb")
    return edit_manifest(copy, lambda values: values.update(recording={"path": "x.mrb"}))


def without_robot(case):
    """The case without its robot, because a scene has no joints."""
    return edit_manifest(
        case, lambda values: [values.pop(key) for key in ("robot", "registration")]
    )


def test_saved_scene_replays_like_its_recording(folder, saved, tmp_path):
    whole = without_robot(shutil.copytree(folder, tmp_path / "mcap"))
    scene = without_robot(recorded_by(folder, saved, tmp_path / "scene"))
    opened = [open_case(each) for each in (whole, scene)]
    of_mcap, of_scene = map(steps_of, opened)
    assert [case.notes() for case in opened] == [(), ()]
    assert len(of_scene) > 100 and MarginState.UNKNOWN in {s.decision.state for s in of_scene[20:]}
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


def test_case_with_a_scene_as_recording_refuses_joints(folder, saved, tmp_path):
    error = refused(recorded_by(folder, saved, tmp_path / "case"))
    assert "robot.joint_states is given: x.mrb cannot hold joints" in error


def test_video_of_a_small_case(can_draw, tmp_path):
    pytest.importorskip("av", reason="the extra video is not installed")
    case, movie = write_small_case(tmp_path / "case"), tmp_path / "m.MP4"
    replay(case, "--movie", movie, "--movie-seconds", "1")
    video = cv2.VideoCapture(str(movie))
    assert video.get(cv2.CAP_PROP_FRAME_COUNT) == 12
    size = (video.get(cv2.CAP_PROP_FRAME_WIDTH), video.get(cv2.CAP_PROP_FRAME_HEIGHT))
    assert size == (800.0, 450.0)
    video.release()


def test_video_without_its_extra_is_refused_before_the_replay(tmp_path, monkeypatch):
    find_spec = extras.find_spec
    monkeypatch.setattr(extras, "find_spec", lambda name: None if name == "av" else find_spec(name))
    case, movie = write_small_case(tmp_path / "case"), tmp_path / "m.mp4"
    error = refused(case, "--movie", movie)
    assert "av is not installed: run `pip install" in error and "write the movie as .gif" in error
    assert not movie.exists()


def test_clock_that_jumps_back_leaves_a_scene_without_recording(tmp_path, capfd):
    case, mrb = write_small_case(tmp_path / "case"), tmp_path / "s.mrb"
    recording = case / "tracking.igs.mha"
    text = recording.read_text().replace("Frame0039_Timestamp = 101.950", "Frame0039_Timestamp = 5")
    recording.write_text(text)
    replay(case, "--save-scene", mrb)
    error = capfd.readouterr().err
    assert error.count("\n") == 1
    assert "without the recording: recording: a frame at 5.000000000 s comes after" in error
    with pytest.raises(InputError, match="no sequence of transforms"):
        list(read_mrml(mrb, print))


NONE = "parent directory does not exist"


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ("--movie replay.avi", "'replay.avi'; expected a file name that ends with .gif or .mp4"),
        ("--save-scene scene.mrml", "'scene.mrml'; expected a file name that ends with .mrb"),
        ("--movie m.gif --movie-seconds 0", "0 s; expected 1 to 60 s"),
        ("--pdf none/r.pdf", NONE),
        ("--movie none/m.gif", NONE),
        (
            "--rate 1 --loop --movie m.gif",
            "--loop: without --rate or with an output file; expected",
        ),
    ],
)
def test_invalid_options_are_refused_before_the_replay(options, message, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert message in refused(write_small_case(tmp_path / "case"), *options.split())
