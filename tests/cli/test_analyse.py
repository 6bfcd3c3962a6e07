import csv
import json
from pathlib import Path

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
    assert set(found["methods"]["inputs_sha256"]) == {"case.yaml", "tracking.igs.mha"}
    assert sorted(path.name for path in folder.iterdir()) == [
        "analysis.csv",
        "breaches.csv",
        "coverage.csv",
    ]


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
    assert "without contour" in text
    assert "without pivot" in text
    rows = [line.split() for line in text.splitlines() if line.startswith("  stop")]
    probabilities = [float(row[4].rstrip(",")) for row in rows]
    assert probabilities[0] > 0.3
    assert probabilities[1] < 0.01


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
