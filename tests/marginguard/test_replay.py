"""Cases and margins through the API, compared with the files of a report."""

import csv
import io
import math
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import trimesh

import marginguard as mg
from app.fixture.proximity.field_cache import cache_folder
from app.report import ReplayLog
from app.report.rows import margin_csv
from app.runtime import ReplayRun, prepare_case

pytestmark = pytest.mark.slow

FRAMES = 12


def ball(frame: str, radius_mm: float) -> mg.SurfaceMesh:
    shape = trimesh.creation.icosphere(3, radius_mm)
    return mg.SurfaceMesh(frame, shape.vertices, shape.faces)


def moved(target: str, source: str, z_mm: float) -> mg.Transform:
    return mg.Transform(target, source, np.eye(3), [0.0, 0.0, z_mm])


MARGINS = mg.MarginParameters(1.0, 5.0, 2.0, 50.0, 60_000_000, 3, 0.5, 1_000_000_000)


def write(folder: Path, **changes: object) -> Path:
    """A ball of 1 mm that moves into a ball of 10 mm, 2 mm per frame; frame 3 is lost."""
    poses = [
        (
            0.02 * index,
            [moved("tracker", "needle", 0.1 * index)]
            + ([] if index == 3 else [moved("tracker", "cautery", 25.0 - 1.9 * index)]),
        )
        for index in range(FRAMES)
    ]
    arguments: dict[str, object] = {
        "tool": ball("cautery_tip", 1.0),
        "tool_from_tip": moved("cautery", "cautery_tip", 0.0),
        "tumor": ball("tumor", 10.0),
        "frame_from_tumor": moved("needle", "tumor", 0.0),
        "margins": MARGINS,
        "name": "two balls",
        "provenance": "simulated",
        "source": "a test",
    }
    return mg.write_case(folder, **{"poses": poses, **arguments, **changes})  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write(tmp_path_factory.mktemp("own") / "case")


@pytest.fixture(scope="module")
def case(folder: Path) -> mg.PreparedCase:
    return mg.open_case(str(folder))


@pytest.fixture(scope="module")
def steps(case: mg.PreparedCase) -> list[mg.StepResult]:
    return list(mg.replay(case))


@pytest.fixture(scope="module")
def expected_csv(folder: Path) -> str:
    """The text that a report of another replay has in ``margin.csv``."""
    log = ReplayLog()
    run = ReplayRun(prepare_case(folder), clock_ns=time.monotonic_ns, outputs=[log])
    assert len(list(run.steps())) == FRAMES
    return margin_csv(log.rows)


def test_table_has_the_columns_and_values_of_margin_csv(steps, expected_csv):
    table = mg.margin_table(steps)
    expected = list(csv.DictReader(io.StringIO(expected_csv)))
    assert list(table.columns) == list(expected[0])
    assert len(table) == len(expected) == FRAMES
    for (_, row), cells in zip(table.iterrows(), expected, strict=True):
        for name, cell in cells.items():
            value = row[name]
            if cell == "":
                assert value is np.nan or math.isnan(value), name
            elif name in ("state", "reasons"):
                assert value == cell
            else:
                assert value == float(cell), name
    assert table["stamp_ns"].dtype == np.int64


def test_table_written_again_is_margin_csv(steps, expected_csv):
    assert mg.margin_table(steps).to_csv(index=False, float_format="%.6f") == expected_csv


def test_distances_are_those_of_two_balls(steps):
    """The centres are 25 - 2 k mm apart; faces of the balls are up to 0.1 mm inside of them."""
    distances = mg.margin_table(steps)["signed_distance_mm"]
    for index, distance in distances.items():
        if index != 3:
            assert abs(distance - (25.0 - 2.0 * float(str(index)) - 11.0)) < 0.15


def test_fields_are_cached_in_the_folder_of_the_run(steps, shared_cache):
    assert cache_folder().parent == shared_cache
    assert list(cache_folder().glob("*.field"))


def test_breaches_are_the_frames_with_a_negative_distance(case, steps):
    (breach,) = mg.find_breaches(case, steps)
    assert (breach.first, breach.last) == (8, 11)
    assert breach.start_s == pytest.approx(0.16)


def test_replay_begins_and_ends_at_the_given_times(case):
    table = mg.margin_table(mg.replay(case, start_s=0.04, end_s=0.1))
    assert table["stamp_ns"].tolist() == [40_000_000, 60_000_000, 80_000_000, 100_000_000]


def test_plot_shows_the_distances(case, steps):
    figure = mg.plot_margin(case, steps)
    lines = {line.get_label(): line for line in figure.axes[1].get_lines()}
    drawn = np.asarray(lines["signed distance"].get_ydata(), dtype=float)
    table = mg.margin_table(steps)
    np.testing.assert_allclose(drawn, table["signed_distance_mm"], atol=1e-6)
    assert figure.axes[1].get_xlabel() == "time from the first frame [s]"


def test_signed_distance_is_that_of_the_replay(steps):
    step = steps[6]
    assert step.tumor_from_tip is not None and step.decision.proximity is not None
    tool, tumor = ball("cautery_tip", 1.0), ball("tumor", 10.0)
    alone = mg.signed_distance(tool, tumor, step.tumor_from_tip)
    # The case holds its surfaces with single precision.
    assert alone.signed_distance_mm == pytest.approx(
        step.decision.proximity.signed_distance_mm, abs=0.02
    )


@pytest.mark.parametrize(
    ("call", "problem"),
    [
        (lambda case, steps: mg.open_case(3), "folder: is 3 (int); expected a path"),
        (lambda case, steps: mg.open_case(""), "folder: is empty; expected a path"),
        (
            lambda case, steps: mg.open_case("x", package_dirs="/my/dirs"),
            "package_dirs: is '/my/dirs' (str); expected a sequence of paths",
        ),
        (
            lambda case, steps: mg.open_case("x", package_dirs=3),
            "package_dirs: is 3 (int); expected a sequence of paths",
        ),
        (
            lambda case, steps: mg.open_case("x", package_dirs=[3]),
            "package_dirs[0]: is 3 (int); expected a path",
        ),
        (lambda case, steps: mg.open_case("package://none/x"), "unknown package"),
        (lambda case, steps: mg.replay("my_case"), "expected a PreparedCase, as open_case returns"),
        (lambda case, steps: mg.replay(case, start_s=-1.0), "start_s: is -1.0; expected seconds"),
        (lambda case, steps: mg.replay(case, end_s="all"), "end_s: is 'all'; expected seconds"),
        (lambda case, steps: mg.margin_table(case), "steps: is PreparedCase("),
        (lambda case, steps: mg.margin_table([]), "steps: there are 0; expected at least 1"),
        (lambda case, steps: mg.margin_table([steps[0], 1]), "steps[1]: is 1 (int); expected a"),
        (lambda case, steps: mg.find_breaches(steps, case), "expected a PreparedCase"),
        (lambda case, steps: mg.plot_margin(steps, steps), "expected a PreparedCase"),
        (lambda case, steps: mg.load_mesh("no.stl", units="inch", frame="a"), "expected one of mm"),
        (lambda case, steps: mg.load_mesh("no.stl", units="mm", frame="a"), "no.stl"),
        (
            lambda case, steps: mg.signed_distance(
                ball("a", 1.0), ball("b", 1.0), moved("a", "b", 0.0)
            ),
            "pose: is a_from_b; expected b_from_a",
        ),
        (lambda case, steps: mg.make_case("new", seed=-1), "seed: is -1; expected an integer"),
        (lambda case, steps: mg.save_scene(case, steps[0], "scene.txt"), "suffix is '.txt'"),
    ],
)
def test_wrong_arguments_are_named_in_one_line(case, steps, call, problem):
    with pytest.raises(mg.MarginGuardError) as raised:
        call(case, steps)
    assert problem in str(raised.value)
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize(
    ("changes", "problem"),
    [
        ({"tool": ball("cautery", 1.0)}, "mesh: is in frame 'cautery'"),
        ({"tumor": ball("ball", 1.0), "frame_from_tumor": moved("needle", "ball", 0)}, "'tumor'"),
        ({"poses": []}, "poses: there are 0; expected at least 1"),
        ({"poses": [(0.0, []), (0.0, [])]}, "poses[1]: time is 0.0 s; expected more than 0 s"),
        ({"poses": [(-1.0, [])]}, "poses[0]: time is -1.0 s; expected 0 s or more"),
        ({"poses": [3]}, "poses[0]: is not a time in s and its poses"),
        ({"poses": 3}, "poses: is 3 (int); expected pairs of a time in s and its poses"),
        ({"poses": [("0.02", [])]}, "poses[0]: time is '0.02' (str); expected a number of s"),
        ({"poses": [(True, [])]}, "poses[0]: time is True (bool); expected a number of s"),
        ({"poses": [(math.nan, [])]}, "poses[0]: is not a time in s and its poses"),
        ({"poses": [(0.0, [3])]}, "poses[0][0]: is 3 (int); expected a Transform"),
        ({"margins": 1.0}, "margins: is 1.0 (float); expected a MarginParameters"),
        ({"provenance": "guessed"}, "expected one of"),
        ({"tumor": mg.SurfaceMesh("tumor", np.eye(3), np.array([[0, 1, 2]]))}, "is not closed"),
    ],
)
def test_faulty_case_is_refused_and_nothing_is_left(tmp_path, changes, problem):
    with pytest.raises(mg.MarginGuardError) as raised:
        write(tmp_path / "case", **changes)
    assert problem in str(raised.value)
    assert list(tmp_path.iterdir()) == []


def test_existing_folder_is_not_overwritten(folder):
    with pytest.raises(mg.InputError, match="already exists"):
        write(folder)
    with pytest.raises(mg.InputError, match="already exists"):
        mg.make_case(folder)


def test_missing_pandas_names_the_extra(steps, monkeypatch):
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(mg.InputError, match=r"pandas cannot be loaded .*\[notebook\]"):
        mg.margin_table(steps)


def test_table_is_a_data_frame(steps):
    table = type(mg.margin_table(steps))
    assert (table.__module__, table.__name__) == ("pandas", "DataFrame")
