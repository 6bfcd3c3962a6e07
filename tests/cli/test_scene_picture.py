"""The process that draws a replay's pictures: its answer, its failures, its end."""

import pickle
import subprocess
import sys

import pytest

from app.case import open_case
from app.cli.scene_picture import MOVIE, PICTURE, SCENE, ScenePainter, SceneRequest
from app.cli.scene_process import warmup_step
from app.fixture import MarginState
from app.geometry import InputError
from app.runtime import content_of
from app.session import Session, setup_from_case
from tests.cli.small_case import write_small_case

pytestmark = pytest.mark.slow

PROCESS = [sys.executable, "-m", "app.cli.scene_process"]
PNG = b"\x89PNG and more"


@pytest.fixture
def painter_of(tmp_path, monkeypatch):
    """``painter_of(end, answer)``: the painter of a process that is a test double.

    The process prints ``answer``, keeps its request in the file ``request`` and runs ``end``.
    """

    def start(end, answer=b""):
        (tmp_path / "answer").write_bytes(answer)
        script = tmp_path / "python"
        script.write_text(f"#!/bin/sh\ncat >{tmp_path}/request\ncat {tmp_path}/answer\n{end}\n")
        script.chmod(0o755)
        monkeypatch.setattr(sys, "executable", str(script))
        return ScenePainter()

    return start


def begin_anything(painter):
    painter._answer = painter._waiting.submit(painter._process.communicate, bytes(10**6))


@pytest.mark.parametrize(("end", "status"), [("exit 1", 1), ("kill -9 $$", -9)])
def test_failed_process_costs_only_the_picture(painter_of, end, status, capsys):
    ended = f"the drawing process ended with status {status}"
    with painter_of(end) as painter:
        begin_anything(painter)
        assert painter.picture() is None
        assert capsys.readouterr().err == f"no scene.png: {ended}\n"
        # A file that the user has requested is an error.
        with pytest.raises(InputError, match=f"no movie: {ended}"):
            painter.content(MOVIE)


@pytest.mark.parametrize("cut", [1, 20])
def test_truncated_answer_gives_no_picture(painter_of, cut, capsys):
    with painter_of("exit 0", pickle.dumps({"picture": PNG})[:-cut]) as painter:
        begin_anything(painter)
        assert painter.picture() is None
    assert "status 0" in capsys.readouterr().err


@pytest.mark.parametrize(("end", "status"), [("exit 3", 3), ("kill -11 $$", -11)])
def test_complete_picture_is_used_whatever_the_exit_status(painter_of, end, status, capsys):
    answer = pickle.dumps({"picture": PNG, "scene": "no space left"})
    with painter_of(end, answer) as painter:
        begin_anything(painter)
        assert painter.picture() == PNG
        with pytest.raises(InputError, match="no scene: no space left"):
            painter.content(SCENE)
    after = f"the drawing process ended with status {status} after it had drawn everything\n"
    assert capsys.readouterr().err == after


def test_arrays_of_the_request_stay_read_only(painter_of, tmp_path):
    case = open_case(write_small_case(tmp_path / "case"))
    setup = setup_from_case(case, tip_only=True)
    step = Session(setup).step(next(case.frames()))
    with painter_of("exit 0") as painter:
        painter.begin(content_of(case, setup, tip_only=True), step)
        painter.picture()
    request: SceneRequest = pickle.loads((tmp_path / "request").read_bytes())
    assert not request.content.tumor.vertices_mm.flags.writeable
    assert request.step.tumor_from_tip is not None
    assert not request.step.tumor_from_tip.rotation.flags.writeable


def test_no_file_without_a_step_of_known_distance_and_process_ends_with_the_context():
    with ScenePainter() as painter:
        process = painter._process
        assert process.poll() is None
        assert painter.picture() is None  # nothing was begun
        with pytest.raises(InputError, match=r"no scene: the distance .* was never known"):
            painter.content(SCENE)
    assert process.poll() is not None


def test_process_without_a_request_ends_silently_in_any_folder(tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    with ScenePainter() as painter:
        answer, _ = painter._process.communicate(b"")
        status = painter._process.returncode
    assert (answer, status, *capfd.readouterr()) == (b"", 0, "", "")


def test_missing_slicer_names_the_remedy(without_scene):
    found = subprocess.run(
        PROCESS,
        input=pickle.dumps(SceneRequest(*warmup_step(), outputs=(PICTURE,))),
        capture_output=True,
        check=True,
        env={"PYTHONPATH": str(without_scene)},
    )
    assert pickle.loads(found.stdout) == {
        "picture": "3D Slicer's scene cannot be loaded (no slicer here): "
        "'marginguard doctor' lists what to install"
    }
    assert found.stderr == b""


def test_warm_up_shows_every_kind_of_object_of_a_picture():
    from app.scene import StepScene

    scene = StepScene(*warmup_step()).scene
    margin = scene.margin
    assert margin is not None
    assert margin.state is MarginState.NEGATIVE
    shown = (scene.tumor, scene.tool, margin.line, margin.plane.node)
    assert all(node.GetDisplayNode().GetVisibility() for node in shown)
    assert margin.plane.node.GetCenterWorld() == pytest.approx((0.0, 0.0, 0.0))
