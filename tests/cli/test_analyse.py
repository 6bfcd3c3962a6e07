import csv
import json
from pathlib import Path

import pyarrow.parquet as pq
import pytest

from app.cli.main import main
from tests.cli.small_case import write_small_case


@pytest.fixture(scope="module")
def case(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_small_case(tmp_path_factory.mktemp("analyse") / "case")


def test_files_and_text_have_the_same_breach(case, tmp_path, capsys):
    json_file, folder = tmp_path / "analysis.json", tmp_path / "tables"
    assert main(["analyse", str(case), "--json", str(json_file), "--csv", str(folder)]) == 0
    text = capsys.readouterr().out
    found = json.loads(json_file.read_text())
    (breach,) = found["breaches"]
    with (folder / "breaches.csv").open() as file:
        (row,) = csv.DictReader(file)
    assert float(row["lowest_sample_mm"]) == pytest.approx(breach["lowest_sample_mm"], abs=1e-6)
    assert breach["lowest_sample_mm"] == pytest.approx(-3.0, abs=0.1)
    assert f"by the {breach['part']}" in text
    inputs = {"case.yaml", "tracking.igs.mha", "tumor.stl", "rod.stl"}
    assert set(found["methods"]["inputs_sha256"]) == inputs
    assert sorted(path.name for path in folder.iterdir()) == [
        "analysis.csv",
        "breaches.csv",
        "coverage.csv",
        "directions.csv",
    ]


def test_sides_and_swept_volume_are_in_all_outputs(case, tmp_path, capsys):
    json_file = tmp_path / "analysis.json"
    options = ["--json", str(json_file), "--csv", str(tmp_path), "--cutting-mm", "4"]
    assert main(["analyse", str(case), *options]) == 0
    text = capsys.readouterr().out
    found = json.loads(json_file.read_text())
    assert found["resection"]["swept_mm3"] > 0.0
    assert found["resection"]["tumor_cut_mm3"] == 0.0  # the shaft is inside, which does not cut
    assert found["resection"]["no_specimen"] == "the swept volume does not enclose the tumour"
    assert "specimen      none: the swept volume does not enclose the tumour" in text
    with (tmp_path / "directions.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [row["side"] for row in rows] == [side["side"] for side in found["sides"]]
    assert len(rows) == 6 and sum(int(row["breaches"]) for row in rows) == 1
    assert {row["margin_mm"] for row in rows} == {""}


def test_page_and_table_of_frames_are_written(case, tmp_path, capsys):
    page, table = tmp_path / "analysis.html", tmp_path / "frames.parquet"
    assert main(["analyse", str(case), "--html", str(page), "--parquet", str(table)]) == 0
    capsys.readouterr()
    assert "<h2>Methods</h2>" in page.read_text()
    rows = pq.read_table(table).to_pylist()
    assert min(row["signed_distance_mm"] for row in rows) == pytest.approx(-3.0, abs=0.1)
    assert {row["hold"] for row in rows} <= {True, False}


def test_two_analyses_are_equal_and_json_is_printed(case, capsys):
    texts = []
    for _ in range(2):
        assert main(["analyse", str(case), "--json"]) == 0
        texts.append(capsys.readouterr().out)
    assert texts[0] == texts[1]
    assert json.loads(texts[0])["anatomical"] is False


def test_probability_of_a_breach_falls_with_the_stop_margin(case, capsys):
    options = ["--error", "contour=0.5", "--error", "pivot=0.2", "--stop", "0", "--stop", "2"]
    assert main(["analyse", str(case), *options]) == 0
    text = capsys.readouterr().out
    assert "no contour error " in text
    assert "no pivot error" in text
    rows = [line.split() for line in text.splitlines() if line.startswith("  stop")]
    probabilities = [float(row[3].rstrip(",")) for row in rows]
    assert probabilities[0] > 0.3
    assert probabilities[1] < 0.01


def test_tables_have_the_probability_of_each_moment_and_of_each_question(case, tmp_path, capsys):
    options = ["--error", "contour=0.5", "--error", "pivot=0.2", "--stop", "2"]
    assert main(["analyse", str(case), *options, "--json", "--csv", str(tmp_path)]) == 0
    document = json.loads(capsys.readouterr().out)
    found = document["breach_probability"]
    with (tmp_path / "moments.csv").open() as file:
        moments = list(csv.DictReader(file))
    assert len(moments) == document["frames"]
    likely = [float(row["probability"]) for row in moments if row["probability"] > "0.001"]
    assert likely == pytest.approx(found["moments"]["probability"], abs=1e-6)
    with (tmp_path / "whatif.csv").open() as file:
        rows = {(row["question"], row["source"]): row for row in csv.DictReader(file)}
    assert set(rows) == {
        ("as recorded", ""),
        *((question, name) for question in ("without", "doubled") for name in ("contour", "pivot")),
        ("stop", ""),
    }
    assert float(rows["without", "contour"]["variance_share"]) == pytest.approx(0.25 / 0.29)
    held = float(rows["stop", ""]["held_s"])
    assert held == pytest.approx(found["stops"][0]["held_s"], abs=1e-6) and held > 0.0
    spread = found["outcome"]["lowest_mm"]
    assert spread[0] < spread[1] < spread[2] < 0.0
    assert spread[2] - spread[0] == pytest.approx(2 * 1.645 * 0.29**0.5, rel=0.1)


def test_places_are_named_by_the_axes_of_the_patient(case, capsys):
    turned = ["-1", "0", "0", "0", "-1", "0", "0", "0", "1"]
    assert main(["analyse", str(case), "--json", "--ras-from-tumor", *turned]) == 0
    (breach,) = json.loads(capsys.readouterr().out)["breaches"]
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
def test_bad_options_are_refused_in_one_line(case, options, problem, capsys):
    try:
        status = main(["analyse", str(case), *options])
    except SystemExit as ended:
        status = ended.code
    assert status == 2
    error = capsys.readouterr().err
    assert problem in error
    assert len(error.splitlines()) == 1
