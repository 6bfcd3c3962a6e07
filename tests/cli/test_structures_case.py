"""Cases of schema 2 by the command line: ground truth of the shipped one, conversion of others."""

import csv
import shutil

import pytest
import yaml

from app.case import open_case
from app.cli.main import main
from tests.cli.command import margin_table, replayed, run_json
from tests.cli.small_case import write_small_case, write_two_tools
from tests.cut_case import write_cut_case
from tests.shipped_case import BASE, SHAFT, SHIPPED_CASE

pytestmark = pytest.mark.slow

CASE = SHIPPED_CASE.parent / "structures_case"
FURTHER = ["lesion_2", "chest_wall"]


def test_every_check_of_the_case_passes():
    summary, _ = replayed(CASE)
    expected = yaml.safe_load((CASE / "expected.yaml").read_text())
    assert [check["result"] for check in summary["expected"]] == ["pass"] * len(summary["expected"])
    assert [each["name"] for each in summary["structures"]] == FURTHER
    for found, true in zip(summary["structures"], expected["structures"], strict=True):
        intervals = true["breaches"]["intervals"]
        assert len(found["breaches"]) == len(intervals)
        for breach, interval in zip(found["breaches"], intervals, strict=True):
            assert breach["start_s"] == pytest.approx(interval["start_s"], abs=0.050)
            assert breach["end_s"] == pytest.approx(interval["end_s"], abs=0.050)
        # Each breach and its depth, and that there is no other.
        checks = [each for each in summary["expected"] if each["check"].startswith(found["name"])]
        assert len(checks) == 2 * len(intervals) + 1


def test_tumour_is_decided_as_in_the_case_with_the_tumour_alone():
    """But for ``latched``: the hold is that of the session."""
    summary, table = replayed(CASE)
    rows, alone = (
        list(csv.DictReader(text.decode().splitlines()))
        for text in (table, replayed(SHIPPED_CASE)[1])
    )
    of_structures = [key for key in rows[0] if key not in alone[0]]
    assert of_structures == [
        f"{name}_{key}"
        for name in FURTHER
        for key in ("state", "signed_distance_mm", "lower_bound_mm")
    ]
    for row, true in zip(rows, alone, strict=True):
        true["reasons"] = ";".join(r for r in true["reasons"].split(";") if r != "latched")
        assert row.items() >= true.items()
    assert summary["inside_frames"] > 0


def test_report_has_the_columns_of_each_structure(tmp_path, without_scene):
    case = write_cut_case(tmp_path / "case", SHAFT["start_s"] - 1.0, 3.0)
    values = yaml.safe_load((CASE / "case.yaml").read_text())
    del values["expected"]
    values["recording"] = {"path": "tracking.mcap"}
    values["robots"][0]["registration"] = {"method": "given", "matrix": BASE}
    (case / "case.yaml").write_text(yaml.safe_dump(values))
    for name in FURTHER:
        shutil.copy(CASE / f"{name}.stl", case)
    summary = run_json("replay", case, "--no-ros", "--report", tmp_path / "report")
    assert [len(each["breaches"]) for each in summary["structures"]] == [2, 1]
    rows = list(csv.DictReader((tmp_path / "report" / "margin.csv").read_text().splitlines()))
    for name in FURTHER:
        assert {"POSITIVE", "WARNING"} <= {row[f"{name}_state"] for row in rows}


def test_case_in_schema_2_gives_the_same_table(tmp_path):
    case = write_cut_case(tmp_path / "case", SHAFT["start_s"] - 1.0, 3.0)
    assert main(["convert", str(case), str(tmp_path / "2"), "--schema", "2"]) == 0
    assert yaml.safe_load((tmp_path / "2" / "case.yaml").read_text())["schema"] == 2
    assert open_case(tmp_path / "2").manifest.structures == ()
    assert margin_table(tmp_path / "2") == margin_table(case)


def test_case_of_schema_2_is_converted_with_the_meshes_of_all_structures(tmp_path):
    assert main(["convert", str(CASE), str(tmp_path / "copy")]) == 0
    for name in FURTHER:
        file = f"{name}.stl"
        assert (tmp_path / "copy" / file).read_bytes() == (CASE / file).read_bytes()
    assert len(open_case(tmp_path / "copy").manifest.structures) == 2


def test_replay_notes_the_nearest_distance_between_tools(tmp_path):
    case = write_two_tools(tmp_path / "two")
    for guarded, other in (("rod", "left"), ("left", "rod")):
        notes = run_json("replay", case, "--tool", guarded, "--no-ros")["notes"]
        line = f"tool '{other}': nearest 2.0 mm at 0.000 s, distance not known in 2 of 40 frames"
        assert line in notes
    alone = margin_table(write_small_case(tmp_path / "alone"))
    assert margin_table(case, tool="rod") == alone
