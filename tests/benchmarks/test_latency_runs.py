"""Short runs of the receivers of the latency benchmark."""

import json
from io import StringIO

import pytest
from rich.console import Console

pytest.importorskip("pyigtl")
pytest.importorskip("rclpy")
pytest.importorskip("slicer")
pytest.importorskip(
    "PySide6.QtCore", reason="PySide6 cannot be loaded: apt install libegl1", exc_type=ImportError
)

from benchmarks.harness.figures import columns_table
from benchmarks.latency.measure import KINDS, LISTENER, STOP_KINDS, measure, measure_stops
from benchmarks.latency.results import STOP_COLUMNS
from tests.ros_domain import domain_id as domain_id
from tests.slicer_module.test_qt_loops import run_checks

pytestmark = pytest.mark.long

BODIES = 4
SECONDS = 0.5
BY_NAME = {kind.name: kind for kind in KINDS}
STOPS_BY_NAME = {kind.name: kind for kind in STOP_KINDS}


def test_plain_listener_measures_the_transport_alone(domain_id):
    run = measure(BY_NAME[LISTENER], SECONDS, BODIES)
    assert run.shown > 0
    assert len(run.transport_ms) == 0


def test_each_stop_of_each_of_two_robots_is_shown(domain_id):
    stops = measure_stops(STOPS_BY_NAME["two robots"], stops=2)
    assert [run.name for run in stops] == ["two robots: left", "two robots: right"]
    for run in stops:
        assert len(run.stops_ms) == 2
        assert (run.stops_ms > 0.0).all()
        assert len(run.frames_ms) > 20
        json.dumps(run.document())
    console = Console(file=StringIO(), width=170)
    console.print(columns_table("title", [run.document() for run in stops], STOP_COLUMNS))
    assert f" {stops[0].stops_ms.mean():.3f} " in console.file.getvalue()


def test_picture_of_a_stop_is_drawn_after_the_scene_shows_it(domain_id):
    (run,) = measure_stops(STOPS_BY_NAME["module ROS2, drawn"], stops=1)
    assert run.pictures_ms[0] > run.stops_ms[0]


def test_checks_in_a_loop_of_qt_pass(project_root):
    run_checks(project_root, "tests/benchmarks/qt_latency_checks.py")
