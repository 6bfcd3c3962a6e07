"""The speed benchmark in short: every engine answers, agrees, and the judgement can fail."""

import json
from dataclasses import replace
from io import StringIO
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from benchmarks.fixture.case import Case
from benchmarks.fixture.engines import ENGINES, OURS, OURS_TIP
from benchmarks.fixture.plot import write_plot
from benchmarks.fixture.results import CaseResult, wishes
from benchmarks.fixture.table import case_table
from benchmarks.fixture.timing import Course, Timing, measure_apart

pytest.importorskip("coal")
pytest.importorskip("vtkmodules")


@pytest.fixture(scope="module")
def case_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("case") / "case.npz"
    Case.of(1280, 500, 200).write(path)
    return path


def measure(case: Path, engine: str, seconds: float) -> Timing:
    course = Course(case, engine, seconds)
    course.go()
    return course.timing()


@pytest.fixture(scope="module")
def result(case_file: Path) -> CaseResult:
    case = Case.read(case_file)
    timings = {name: measure(case_file, name, 0.2) for name in ENGINES}
    return CaseResult(1280, 492, len(case.trajectory), case.speeds(), timings)


def test_engines_of_the_same_quantity_agree(result: CaseResult) -> None:
    # Ours may be above the true distance by 0.005 mm and 0.2 % of at most some 10 mm.
    for name in ("fcl", "coal"):
        assert result.agreement(name) < 0.03
    for name in ("vtk tip", "vtk tip rebuilt"):
        assert result.agreement(name) < 1e-3
    assert result.agreement("vtk filter") == 1.0
    # Vertices alone see less than the mesh.
    ours, vertices = result.timings[OURS], result.timings["vtk vertices"]
    differences = vertices.answers_mm - ours.answers_mm[vertices.asked]
    assert differences.min() > -0.01
    assert differences.max() > 0.05


def test_trajectory_stays_within_ten_millimetres_and_penetrates(result: CaseResult) -> None:
    distances = result.timings[OURS].answers_mm
    assert distances.max() < 11.0
    assert result.inside == int((distances <= 0.0).sum())


def test_slow_engine_is_sampled_along_the_whole_trajectory(case_file: Path) -> None:
    timing = measure(case_file, "vtk tip rebuilt", 0.02)
    assert 10 <= len(timing.asked) < 200
    assert (timing.asked[0], timing.asked[-1]) == (0, 199)


def test_separate_processes_give_the_same_results(case_file: Path, result: CaseResult) -> None:
    apart = measure_apart(case_file, [OURS_TIP, "vtk tip"], 1.0, rounds=2)
    for name, timing in apart.items():
        here = result.timings[name]
        assert timing.engine == name
        assert timing.answers_mm[here.asked] == pytest.approx(here.answers_mm, abs=1e-12)


def test_fastest_round_of_each_pose_counts(case_file: Path) -> None:
    course = Course(case_file, OURS_TIP, 1.0)
    course.go()
    first = course.timing()
    for _ in range(4):
        course.go()
    last = course.timing()
    assert last.p50_ms <= first.p50_ms
    assert last.max_ms <= first.max_ms
    assert last.wall_p99_ms <= first.wall_p99_ms
    assert last.max_ms > 0.0


def test_table_plot_and_document_contain_every_engine(result: CaseResult, tmp_path: Path) -> None:
    console = Console(width=130, file=StringIO())
    console.print(case_table(result))
    text = console.file.getvalue()
    rows = json.loads(json.dumps(result.document()))["engines"]
    assert {row["engine"] for row in rows} == set(ENGINES)
    assert all(name in text for name in ENGINES)
    write_plot([result], tmp_path / "plot.png")
    assert (tmp_path / "plot.png").read_bytes().startswith(b"\x89PNG")


def timing(engine: str, p50_ms: float, p99_ms: float) -> Timing:
    nothing = np.zeros(0)
    return Timing(engine, 0.0, 0.0, p50_ms, p99_ms, p99_ms, p99_ms, p99_ms, nothing, nothing)


def case_result(triangles: int, ours: Timing, fcl: Timing) -> CaseResult:
    return CaseResult(triangles, 1992, 10, {}, {OURS: ours, "fcl": fcl})


def test_targets_are_met_missed_or_not_measured() -> None:
    ours, fcl = timing(OURS, 0.1, 0.4), timing("fcl", 1.1, 2.5)
    good = [case_result(81_920, ours, fcl), case_result(1_310_720, ours, fcl)]
    assert [wish.good for wish in wishes(good)] == [True] * 5
    slow = [
        case_result(81_920, replace(ours, p50_ms=0.2, p99_ms=0.6), fcl),
        case_result(1_310_720, replace(ours, p50_ms=0.4, p99_ms=1.0), fcl),
    ]
    assert [wish.good for wish in wishes(slow)] == [False] * 5
    assert [wish.good for wish in wishes(good[:1])] == [True] * 3 + [None] * 2
    assert [wish.good for wish in wishes([])] == [None] * 5
