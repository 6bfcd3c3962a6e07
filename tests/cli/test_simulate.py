"""``marginguard simulate`` beside ``marginguard live``, each a process of its own."""

import io
import signal
import sys

import numpy as np
import pytest

from app.cli.main import main
from app.igtl import IgtlSource, SampleQueue

pytestmark = pytest.mark.long


def test_live_session_follows_the_tracker_of_a_simulated_world(start, domain_id, project_root):
    world = project_root / "data" / "worlds" / "lumpectomy"
    simulation = start("-m", "app.cli", "simulate", str(world))
    assert simulation.line().startswith("SIMULATION of lumpectomy, arms: /arm")
    live = start("-m", "app.cli", "live", "--config", str(world / "live.yaml"))
    line = live.line(lambda line: line.startswith("NEGATIVE"))
    # 58 mm between the origins; the tumour is some 8 mm in radius, the tool's tip at its origin.
    assert 35.0 < float(line.split()[1]) < 55.0
    assert live.end(signal.SIGINT) == 130
    assert simulation.end(signal.SIGINT) == 130


def test_tracker_is_sent_over_openigtlink(start, domain_id, project_root):
    world = project_root / "data" / "worlds" / "lumpectomy"
    simulation = start("-m", "app.cli", "simulate", str(world), "--igtl", "0")
    line = simulation.line(lambda line: line.startswith("OpenIGTLink: port "))
    queue = SampleQueue()
    found = {}
    with IgtlSource("127.0.0.1", int(line.split()[2]), queue.put):
        while {"tumor", "cautery"} - found.keys():
            samples = queue.take(60.0)
            assert samples, "nothing within 60 s"
            found |= {each.source: each for each in samples}
    assert found["tumor"].target == "tracker"
    # Place of the tumour in the world file; it breathes by some mm.
    np.testing.assert_allclose(
        found["tumor"].transform.translation_mm, [205.0, 0.0, 80.0], atol=8.0
    )
    assert simulation.end(signal.SIGINT) == 130


@pytest.mark.parametrize(
    ("options", "problem"),
    [
        (["--igtl", "70000"], "--igtl is 70000; expected a port from 0 to 65535"),
        (["--igtl", "0", "--with", "live"], "--igtl with --with or --view; expected one of them"),
    ],
)
def test_unusable_openigtlink_options_are_refused(options, problem, capsys, project_root):
    world = project_root / "data" / "worlds" / "lumpectomy"
    assert main(["simulate", str(world), *options]) == 2
    (line,) = [each for each in capsys.readouterr().err.splitlines() if "error" in each]
    assert problem in line


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        (None, "expected"),
        ("schema: 1\nname: x\nseed: 1\ncolour: red\n", "colour is unknown"),
        ("schema: 1\nname: x\n", "seed is missing"),
    ],
)
def test_bad_world_is_refused_in_one_line(text, problem, tmp_path, capsys):
    path = tmp_path / "world.yaml"
    if text is not None:
        path.write_text(text)
    assert main(["simulate", str(path)]) == 2
    captured = capsys.readouterr()
    (line,) = [each for each in captured.err.splitlines() if "error" in each]
    assert problem in line
    assert not captured.out


@pytest.mark.parametrize(
    ("options", "problem"),
    [
        (["--hand", "joy"], "--hand joy: the world has no hand.joy; expected one"),
        (["--hand", "device"], "--hand device: the world has no hand.device; expected one"),
        (
            ["--hand", "keyboard"],
            "--hand keyboard: the standard input is no terminal; expected one",
        ),
    ],
)
def test_hand_that_is_not_there_is_refused_in_one_line(
    options, problem, tmp_path, capsys, project_root, monkeypatch
):
    shipped = project_root / "data" / "worlds" / "lumpectomy"
    text = (shipped / "world.yaml").read_text()
    text = text[: text.index("  joy:")].replace("chest_wall.stl", str(shipped / "chest_wall.stl"))
    path = tmp_path / "world.yaml"
    path.write_text(text)
    monkeypatch.setattr(sys, "stdin", io.StringIO())
    assert main(["simulate", str(path), *options]) == 2
    captured = capsys.readouterr()
    (line,) = [each for each in captured.err.splitlines() if "error" in each]
    assert problem in line
    assert "SIMULATION" not in captured.out
