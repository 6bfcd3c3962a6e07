"""``marginguard simulate`` beside ``marginguard live``, each a process of its own."""

import io
import signal
import sys

import numpy as np
import pytest

from app.igtl import IgtlSource, SampleQueue
from tests.cli.command import run

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


def refused(*words):
    """The one line about bad input; nothing is simulated."""
    printed = run("simulate", *words, status=2)
    (line,) = [each for each in printed.err.splitlines() if "error" in each]
    assert not printed.out
    return line


@pytest.mark.parametrize(
    ("options", "problem"),
    [
        (["--igtl", "70000"], "--igtl is 70000; expected a port from 0 to 65535"),
        (["--igtl", "0", "--with", "live"], "--igtl with --with or --view; expected one of them"),
    ],
)
def test_unusable_openigtlink_options_are_refused(options, problem, project_root):
    assert problem in refused(project_root / "data" / "worlds" / "lumpectomy", *options)


def test_bad_world_is_refused_in_one_line(tmp_path):
    path = tmp_path / "world.yaml"
    path.write_text("schema: 1\nname: x\nseed: 1\ncolour: red\n")
    assert "colour is unknown" in refused(path)


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
    options, problem, tmp_path, project_root, monkeypatch
):
    shipped = project_root / "data" / "worlds" / "lumpectomy"
    text = (shipped / "world.yaml").read_text()
    text = text[: text.index("  joy:")].replace("chest_wall.stl", str(shipped / "chest_wall.stl"))
    path = tmp_path / "world.yaml"
    path.write_text(text)
    monkeypatch.setattr(sys, "stdin", io.StringIO())
    assert problem in refused(path, *options)
