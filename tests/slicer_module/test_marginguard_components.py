"""Alarm, jobs, tumour input and installation check of the module."""

import ast
import sys
import threading

import pytest

from app.fixture import MarginState
from app.geometry import InputError
from tests.python_process import run_python
from tests.slicer_module.marginguard_module import FOLDER

from MarginGuardLib import installation  # isort: skip
from MarginGuardLib.status import REPEAT_NS, Alarm  # isort: skip
from MarginGuardLib.jobs import Jobs  # isort: skip
from MarginGuardLib.panel_inputs import surface_of  # isort: skip

pytestmark = pytest.mark.slow

POSITIVE, WARNING = MarginState.POSITIVE, MarginState.WARNING


def test_alarm_sounds_at_once_and_repeats():
    alarm = Alarm()
    assert not alarm.due(WARNING, 0)
    assert not alarm.due(MarginState.UNKNOWN, 0)
    assert alarm.due(POSITIVE, 5)
    assert not alarm.due(POSITIVE, 4 + REPEAT_NS)
    assert alarm.due(POSITIVE, 5 + REPEAT_NS)
    assert not alarm.due(WARNING, 6 + REPEAT_NS)
    assert alarm.due(POSITIVE, 7 + REPEAT_NS)  # another breach


def test_muted_alarm_sounds_when_unmuted():
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


def test_job_runs_in_other_thread_and_result_is_collected_here(jobs):
    threads = []
    proceed = threading.Event()

    def work():
        proceed.wait()
        threads.append(threading.current_thread())
        return 7

    taken = []
    jobs.submit("counting", work, lambda number: taken.append((number, threading.current_thread())))
    assert jobs.current == "counting"
    assert jobs.collect() == ""
    assert taken == []
    proceed.set()
    jobs.wait(60.0)
    assert jobs.collect() == ""
    assert taken == [(7, threading.current_thread())]
    assert threads != [threading.current_thread()]
    assert jobs.current == ""


def test_failing_job_is_one_line_and_next_job_runs(jobs):
    def refuse():
        raise InputError("this\nand that")

    taken = []
    jobs.submit("first", refuse, taken.append)
    jobs.submit("second", lambda: 2, taken.append)
    jobs.wait(60.0)
    failure = jobs.collect()
    while jobs.current:
        jobs.wait(60.0)
        failure = jobs.collect() or failure
    assert failure == "first: this and that"
    assert taken == [2]


def test_tumour_surface_from_points_and_segments(monkeypatch):
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
    with pytest.raises(SceneError, match="'Parts' has 0 segments and none is named; expected"):
        surface_of(segmentation, "", "tumor", frame)
    with pytest.raises(SceneError, match="vtkMRMLLinearTransformNode"):
        surface_of(frame, "", "tumor", frame)


def test_this_installation_has_no_problem():
    assert installation.missing_requirement() == ""


@pytest.mark.parametrize("file", ["MarginGuard.py", "MarginGuardLib/installation.py"])
def test_version_check_parses_under_old_python(file):
    ast.parse((FOLDER / file).read_text(), feature_version=(3, 9))


def test_old_python_is_reported(monkeypatch):
    monkeypatch.setattr(sys, "version_info", (3, 9, 10, "final", 0))
    assert (
        installation.missing_requirement()
        == "MarginGuard needs Python 3.11 or later; this Slicer has 3.9"
    )


def test_missing_environment_is_reported_with_remedy():
    code = (
        "from MarginGuardLib.installation import missing_requirement; print(missing_requirement())"
    )
    done = run_python("-S", "-c", code, cwd=FOLDER, env={"PATH": "/usr/bin"})
    assert done.stdout.startswith("MarginGuard cannot be loaded (No module named 'app')")
    assert "marginguard slicer --slicer PATH" in done.stdout
    assert done.stdout.count("\n") == 1


@pytest.mark.parametrize("name", ["app.bridge", "MarginGuardLib.logic"])
@pytest.mark.parametrize(
    "error", [OSError("libsomething.so: no such file"), RuntimeError("other\nABI"), KeyError()]
)
def test_import_error_of_any_type_is_one_line(monkeypatch, name, error):
    def load(module):
        if module == name:
            raise error

    monkeypatch.setattr(installation, "import_module", load)
    problem = installation.missing_requirement()
    assert "cannot be loaded" in problem
    assert "\n" not in problem
