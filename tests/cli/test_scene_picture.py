import pickle
import subprocess
import sys
from pathlib import Path

import pytest

from app.case import open_case
from app.cli.render_warmup import warmup_step
from app.cli.scene_picture import MOVIE, PICTURE, SCENE, ScenePainter, SceneRequest
from app.geometry import InputError
from app.runtime import content_of
from app.session import Session, setup_from_case
from tests.cli.small_case import write_small_case

PROCESS = [sys.executable, "-m", "app.cli.scene_process"]
PNG = b"\x89PNG and more"


def begin_anything(painter: ScenePainter) -> None:
    painter._answer = painter._waiting.submit(painter._process.communicate, bytes(10**6))


def stand_in(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, end: str) -> None:
    """Test double of the process: prints the file ``answer`` and then runs ``end``."""
    script = tmp_path / "python"
    script.write_text(
        f"#!/bin/sh\ncat >{tmp_path}/request\ncat {tmp_path}/answer 2>/dev/null\n{end}\n"
    )
    script.chmod(0o755)
    monkeypatch.setattr(sys, "executable", str(script))


@pytest.mark.parametrize(("end", "status"), [("exit 1", 1), ("kill -9 $$", -9)])
def test_failed_process_costs_only_the_picture(
    end: str,
    status: int,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    stand_in(tmp_path, monkeypatch, end)
    with ScenePainter() as painter:
        begin_anything(painter)
        assert painter.picture() is None
        assert (
            capsys.readouterr().err
            == f"no scene.png: the drawing process ended with status {status}\n"
        )
        # A file that the user has requested is an error.
        with pytest.raises(
            InputError, match=f"no movie: the drawing process ended with status {status}"
        ):
            painter.content(MOVIE)


@pytest.mark.parametrize("cut", [1, 20])
def test_truncated_answer_gives_no_picture(
    cut: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    stand_in(tmp_path, monkeypatch, "exit 0")
    (tmp_path / "answer").write_bytes(pickle.dumps({"picture": PNG})[:-cut])
    with ScenePainter() as painter:
        begin_anything(painter)
        assert painter.picture() is None
    assert "status 0" in capsys.readouterr().err


@pytest.mark.parametrize(("end", "status"), [("exit 3", 3), ("kill -11 $$", -11)])
def test_complete_picture_is_used_whatever_the_exit_status(
    end: str,
    status: int,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    stand_in(tmp_path, monkeypatch, end)
    (tmp_path / "answer").write_bytes(pickle.dumps({"picture": PNG, "scene": "no space left"}))
    with ScenePainter() as painter:
        begin_anything(painter)
        assert painter.picture() == PNG
        with pytest.raises(InputError, match="no scene: no space left"):
            painter.content(SCENE)
    error = capsys.readouterr().err
    assert (
        error == f"the drawing process ended with status {status} after it had drawn everything\n"
    )


def test_arrays_of_the_request_stay_read_only(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    case = open_case(write_small_case(tmp_path / "case"))
    setup = setup_from_case(case, tip_only=True)
    step = Session(setup).step(next(case.frames()))
    stand_in(tmp_path, monkeypatch, "exit 0")
    with ScenePainter() as painter:
        painter.begin(content_of(case, setup, tip_only=True), step)
        painter.picture()
    request: SceneRequest = pickle.loads((tmp_path / "request").read_bytes())
    assert not request.content.tumor.vertices_mm.flags.writeable
    assert request.step.tumor_from_tip is not None
    assert not request.step.tumor_from_tip.rotation.flags.writeable


def test_no_file_without_a_step_of_known_distance() -> None:
    never = r"no scene: the distance .* was never known"
    with ScenePainter() as painter, pytest.raises(InputError, match=never):
        painter.content(SCENE)


def test_process_ends_with_the_context() -> None:
    with ScenePainter() as painter:
        process = painter._process
        assert process.poll() is None
        assert painter.picture() is None  # nothing was begun
    assert process.poll() is not None


def test_process_finds_the_package_from_any_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    with ScenePainter() as painter:
        painter._process.communicate(b"")
        status = painter._process.returncode
    assert (status, capfd.readouterr().err) == (0, "")


def test_missing_slicer_names_the_remedy(tmp_path: Path) -> None:
    (tmp_path / "slicer.py").write_text("raise ImportError('no slicer here')\n")
    found = subprocess.run(
        PROCESS,
        input=pickle.dumps(SceneRequest(*warmup_step(), outputs=(PICTURE,))),
        capture_output=True,
        check=True,
        env={"PYTHONPATH": str(tmp_path)},
    )
    assert pickle.loads(found.stdout) == {
        "picture": "3D Slicer's scene cannot be loaded (no slicer here): "
        "'marginguard doctor' lists what to install"
    }
    assert found.stderr == b""


def test_process_without_a_request_ends_silently() -> None:
    found = subprocess.run(PROCESS, input=b"", capture_output=True, check=True)
    assert (found.stdout, found.stderr) == (b"", b"")
