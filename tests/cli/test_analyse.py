"""``marginguard analyse``: the same results as text, JSON, CSV, Parquet and HTML."""

import csv
import json
from types import SimpleNamespace

import pyarrow.parquet as pq
import pytest

from tests.cli.command import refused, run, run_json
from tests.cli.small_case import write_small_case

pytestmark = pytest.mark.slow

CUTTING = ("--cutting-mm", "4")
ERRORS = ("--error", "contour=0.5", "--error", "pivot=0.2", "--stop", "0", "--stop", "2")


@pytest.fixture(scope="module")
def case(tmp_path_factory):
    return write_small_case(tmp_path_factory.mktemp("analyse") / "case")


def analysed(case, folder, *options):
    """Text, JSON document and tables of one analysis, which wrote its files to ``folder``."""
    file, tables = folder / "analysis.json", folder / "tables"
    text = run("analyse", case, "--json", file, "--csv", tables, *options).out
    rows = {path.stem: list(csv.DictReader(path.open())) for path in tables.iterdir()}
    return SimpleNamespace(text=text, json=json.loads(file.read_text()), tables=rows, folder=folder)


@pytest.fixture(scope="module")
def analysis(case, tmp_path_factory):
    folder = tmp_path_factory.mktemp("analysis")
    files = ("--html", folder / "analysis.html", "--parquet", folder / "frames.parquet")
    return analysed(case, folder, *CUTTING, *files)


@pytest.fixture(scope="module")
def with_errors(case, tmp_path_factory):
    """With the error of two sources, and the axes of the patient."""
    turned = ("--ras-from-tumor", *("-1", "0", "0", "0", "-1", "0", "0", "0", "1"))
    return analysed(case, tmp_path_factory.mktemp("errors"), *ERRORS, *turned)


def test_files_and_text_have_the_same_breach(analysis):
    (breach,), (row,) = analysis.json["breaches"], analysis.tables["breaches"]
    assert float(row["lowest_sample_mm"]) == pytest.approx(breach["lowest_sample_mm"], abs=1e-6)
    assert breach["lowest_sample_mm"] == pytest.approx(-3.0, abs=0.1)
    assert f"by the {breach['part']}" in analysis.text
    inputs = {"case.yaml", "tracking.igs.mha", "tumor.stl", "rod.stl"}
    assert set(analysis.json["methods"]["inputs_sha256"]) == inputs
    assert set(analysis.tables) == {"analysis", "breaches", "coverage", "directions"}


def test_sides_and_swept_volume_are_in_all_outputs(analysis):
    resection, rows = analysis.json["resection"], analysis.tables["directions"]
    assert resection["swept_mm3"] > 0.0
    assert resection["tumor_cut_mm3"] == 0.0  # the shaft is inside, which does not cut
    assert resection["no_specimen"] == "the swept volume does not enclose the tumour"
    assert "specimen      none: the swept volume does not enclose the tumour" in analysis.text
    assert [row["side"] for row in rows] == [side["side"] for side in analysis.json["sides"]]
    assert len(rows) == 6 and sum(int(row["breaches"]) for row in rows) == 1
    assert {row["margin_mm"] for row in rows} == {""}


def test_page_and_table_of_frames_are_written(analysis):
    assert "<h2>Methods</h2>" in (analysis.folder / "analysis.html").read_text()
    rows = pq.read_table(analysis.folder / "frames.parquet").to_pylist()
    assert min(row["signed_distance_mm"] for row in rows) == pytest.approx(-3.0, abs=0.1)
    assert {row["hold"] for row in rows} <= {True, False}


def test_two_analyses_are_equal_and_json_is_printed(case, analysis):
    found = run_json("analyse", case, *CUTTING)
    assert found == analysis.json
    assert found["anatomical"] is False


def test_probability_of_a_breach_falls_with_the_stop_margin(with_errors):
    assert "no contour error " in with_errors.text
    assert "no pivot error" in with_errors.text
    rows = [line.split() for line in with_errors.text.splitlines() if line.startswith("  stop")]
    probabilities = [float(row[3].rstrip(",")) for row in rows]
    assert probabilities[0] > 0.3
    assert probabilities[1] < 0.01


def test_tables_have_the_probability_of_each_moment_and_of_each_question(with_errors):
    found, moments = with_errors.json["breach_probability"], with_errors.tables["moments"]
    assert len(moments) == with_errors.json["frames"]
    likely = [float(row["probability"]) for row in moments if row["probability"] > "0.001"]
    assert likely == pytest.approx(found["moments"]["probability"], abs=1e-6)
    rows = {(row["question"], row["source"]): row for row in with_errors.tables["whatif"]}
    assert set(rows) == {
        ("as recorded", ""),
        *((question, name) for question in ("without", "doubled") for name in ("contour", "pivot")),
        ("stop", ""),
    }
    assert float(rows["without", "contour"]["variance_share"]) == pytest.approx(0.25 / 0.29)
    held = float(rows["stop", ""]["held_s"])
    assert held == pytest.approx(found["stops"][-1]["held_s"], abs=1e-6) and held > 0.0
    spread = found["outcome"]["lowest_mm"]
    assert spread[0] < spread[1] < spread[2] < 0.0
    assert spread[2] - spread[0] == pytest.approx(2 * 1.645 * 0.29**0.5, rel=0.1)


def test_places_are_named_by_the_axes_of_the_patient(with_errors):
    (breach,) = with_errors.json["breaches"]
    assert breach["side"] in {"left", "right", "anterior", "posterior", "superior", "inferior"}


@pytest.mark.parametrize(
    ("options", "problem"),
    [
        (["--ras-from-tumor", *"111111111"], "is no rotation"),
        (["--stop", "1"], "expected at least one --error"),
        (["--error", "contour"], "expected NAME=MM"),
        (["--cutting-mm", "0"], "expected more than 0"),
        (["--bias-mm", "-1"], "expected 0 or more"),
        (["--json", "missing/folder.json"], "parent directory does not exist"),
    ],
)
def test_bad_options_are_refused_in_one_line(case, options, problem):
    assert problem in refused("analyse", case, *options)
