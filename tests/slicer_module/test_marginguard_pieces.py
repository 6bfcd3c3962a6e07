"""The small pieces of the module's logic."""

import ast
import subprocess
import sys
import threading

import pytest

from app.fixture import MarginState
from app.geometry import InputError
from tests.slicer_module.marginguard_module import FOLDER

from MarginGuardLib import installation  # isort: skip
from MarginGuardLib.alarm import REPEAT_NS, Alarm  # isort: skip
from MarginGuardLib.jobs import Jobs  # isort: skip
from MarginGuardLib.tumor_input import surface_of  # isort: skip

POSITIVE, WARNING = MarginState.POSITIVE, MarginState.WARNING


def test_the_alarm_sounds_at_once_and_then_now_and_then():
    alarm = Alarm()
    assert not alarm.due(WARNING, 0)
    assert not alarm.due(MarginState.UNKNOWN, 0)
    assert alarm.due(POSITIVE, 5)
    assert not alarm.due(POSITIVE, 4 + REPEAT_NS)
    assert alarm.due(POSITIVE, 5 + REPEAT_NS)
    assert not alarm.due(WARNING, 6 + REPEAT_NS)
    assert alarm.due(POSITIVE, 7 + REPEAT_NS)  # another breach


def test_a_muted_alarm_sounds_as_soon_as_it_is_not_muted_any_more():
    alarm = Alarm()
    alarm.muted = True
    assert not alarm.due(POSITIVE, 0)
    alarm.muted = False
    assert alarm.due(POSITIVE, 1)


@pytest.fixture
def jobs():
    jobs = Jobs()
    yield jobs
    jobs.close()


def test_a_job_is_done_elsewhere_and_its_result_is_taken_here(jobs):
    threads = []
    go_on = threading.Event()

    def work():
        go_on.wait()
        threads.append(threading.current_thread())
        return 7

    taken = []
    jobs.begin("counting", work, lambda number: taken.append((number, threading.current_thread())))
    assert jobs.running == "counting"
    assert jobs.collect() == ""
    assert taken == []
    go_on.set()
    jobs.wait(60.0)
    assert jobs.collect() == ""
    assert taken == [(7, threading.current_thread())]
    assert threads != [threading.current_thread()]
    assert jobs.running == ""


def test_a_job_that_fails_is_one_line_and_the_next_one_is_done(jobs):
    def refuse():
        raise InputError("this\nand that")

    taken = []
    jobs.begin("first", refuse, taken.append)
    jobs.begin("second", lambda: 2, taken.append)
    jobs.wait(60.0)
    said = jobs.collect()
    while jobs.running:
        jobs.wait(60.0)
        said = jobs.collect() or said
    assert said == "first: this and that"
    assert taken == [2]


def test_segments_and_points_mark_a_tumour(monkeypatch):
    import numpy as np
    import slicer

    from app.scene import SceneApplication, SceneError

    scene = SceneApplication(slicer.vtkMRMLScene()).scene
    frame = scene.AddNewNodeByClass("vtkMRMLLinearTransformNode")
    points = scene.AddNewNodeByClass("vtkMRMLMarkupsFiducialNode")
    corners = 10.0 * np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]])
    for point in corners:
        points.AddControlPoint(point.tolist())
    around = surface_of(points, "", "tumor", frame)
    assert around.frame == "tumor"
    assert around.open_edges() == 0
    assert np.linalg.norm(around.vertices_mm, axis=1) == pytest.approx(10.0, abs=0.1)

    segmentation = scene.AddNewNodeByClass("vtkMRMLSegmentationNode", "Parts")
    with pytest.raises(SceneError, match="'Parts' has 0 segments: the name of one wanted"):
        surface_of(segmentation, "", "tumor", frame)
    with pytest.raises(SceneError, match="vtkMRMLLinearTransformNode"):
        surface_of(frame, "", "tumor", frame)


def test_this_installation_can_run_the_module():
    assert installation.missing_requirement() == ""


@pytest.mark.parametrize("file", ["MarginGuard.py", "MarginGuardLib/installation.py"])
def test_what_says_that_a_python_is_too_old_can_be_read_by_it(file):
    ast.parse((FOLDER / file).read_text(), feature_version=(3, 9))


def test_a_slicer_whose_python_is_too_old_says_so(monkeypatch):
    monkeypatch.setattr(sys, "version_info", (3, 9, 10, "final", 0))
    assert (
        installation.missing_requirement()
        == "MarginGuard needs Python 3.11 or later; this Slicer has 3.9"
    )


def test_a_slicer_that_was_started_without_the_environment_says_how():
    code = (
        "from MarginGuardLib.installation import missing_requirement; print(missing_requirement())"
    )
    done = subprocess.run(
        [sys.executable, "-S", "-c", code],
        capture_output=True,
        text=True,
        cwd=FOLDER,
        env={"PATH": "/usr/bin"},
        check=True,
    )
    assert done.stdout.startswith("MarginGuard cannot be loaded (No module named 'app')")
    assert "marginguard slicer --slicer PATH" in done.stdout
    assert done.stdout.count("\n") == 1


@pytest.mark.parametrize("name", ["app.bridge", "MarginGuardLib.logic"])
@pytest.mark.parametrize(
    "error", [OSError("libsomething.so: no such file"), RuntimeError("other\nABI"), KeyError()]
)
def test_packages_that_do_not_fit_are_one_line_whatever_they_raise(monkeypatch, name, error):
    def load(wanted):
        if wanted == name:
            raise error

    monkeypatch.setattr(installation, "import_module", load)
    said = installation.missing_requirement()
    assert "cannot be loaded" in said
    assert "\n" not in said


def test_the_logic_needs_nothing_that_desktop_slicer_has_not():
    """Neither trame-slicer, the wheels' own way to views, nor Qt; matplotlib stays unloaded."""
    code = (
        "import sys\n"
        "sys.modules |= dict.fromkeys(('trame', 'trame_slicer', 'PySide6'))\n"
        "import MarginGuardLib.logic\n"
        "print('matplotlib' in sys.modules)"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, cwd=FOLDER, check=False
    )
    assert done.stdout == "False\n", done.stderr
