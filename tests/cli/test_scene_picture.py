import subprocess
import sys
from pathlib import Path

import pytest

from app.cli.scene_picture import ScenePainter

PROCESS = [sys.executable, "-m", "app.cli.scene_process"]


def begin_anything(painter: ScenePainter, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("app.cli.scene_picture._moment", lambda *_, **__: {"much": bytes(10**6)})
    painter.begin(None, None, None, with_tool=True)  # type: ignore[arg-type]


@pytest.mark.parametrize(("end", "status"), [("exit 1", 1), ("kill -9 $$", -9)])
def test_a_process_that_fails_costs_the_picture_alone(
    end: str,
    status: int,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    script = tmp_path / "python"
    script.write_text(f"#!/bin/sh\n{end}\n")
    script.chmod(0o755)
    monkeypatch.setattr(sys, "executable", str(script))
    with ScenePainter() as painter:
        begin_anything(painter, monkeypatch)
        assert painter.picture() is None
    assert capsys.readouterr().err == f"no scene.png: drawing it ended with status {status}\n"


def test_the_process_ends_with_the_context() -> None:
    with ScenePainter() as painter:
        process = painter._process
        assert process.poll() is None
        assert painter.picture() is None  # nothing was begun
    assert process.poll() is not None


def test_the_process_finds_the_package_from_any_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    with ScenePainter() as painter:
        painter._process.communicate(b"")
        status = painter._process.returncode
    assert (status, capfd.readouterr().err) == (0, "")


def test_without_slicer_it_says_what_to_do(tmp_path: Path) -> None:
    (tmp_path / "slicer.py").write_text("raise ImportError('no slicer here')\n")
    found = subprocess.run(
        PROCESS, input=b"", capture_output=True, check=True, env={"PYTHONPATH": str(tmp_path)}
    )
    assert found.stdout == b""
    assert found.stderr.decode() == (
        "no scene.png: no slicer here; 'marginguard doctor' says what to install\n"
    )


def test_it_ends_quietly_when_nothing_is_to_be_drawn() -> None:
    found = subprocess.run(PROCESS, input=b"", capture_output=True, check=True)
    assert (found.stdout, found.stderr) == (b"", b"")
