"""The shipped cases: what each expected.yaml lists is found, and a needle's plan has its page."""

import pytest
import yaml

from tests.cli.command import run, run_json
from tests.cli.test_plan_needle import DISC, NEEDLE
from tests.cli.test_structures_case import check_structures
from tests.cut_case import STRUCTURES_CASE
from tests.shipped_case import FRAMES, SHIPPED_CASE

pytestmark = pytest.mark.long


def test_every_check_of_the_case_passes():
    summary = run_json("replay", SHIPPED_CASE, "--no-ros")
    expected = yaml.safe_load((SHIPPED_CASE / "expected.yaml").read_text())
    intervals = expected["breaches"]["intervals"]
    assert summary["frames"] == FRAMES
    assert len(summary["breaches"]) == len(intervals) == 3
    for found, true in zip(summary["breaches"], intervals, strict=True):
        assert found["start_s"] == pytest.approx(true["start_s"], abs=0.040)
        assert found["end_s"] == pytest.approx(true["end_s"], abs=0.040)
    assert [check["result"] for check in summary["expected"]] == ["pass"] * len(summary["expected"])
    assert sum(interval["shaft_only"] for interval in intervals) == 1


def test_every_check_of_the_case_with_three_structures_passes():
    summary = run_json("replay", STRUCTURES_CASE, "--no-ros")
    check_structures(summary, STRUCTURES_CASE)
    assert summary["inside_frames"] > 0


def test_page_of_a_plan_has_both_pictures_and_no_script(tmp_path):
    report = tmp_path / "report"
    run("plan", "needle", STRUCTURES_CASE, *NEEDLE, *DISC, "--report", report)
    page = (report / "needle.html").read_text()
    assert page.count("data:image/png;base64,") == 2
    assert "chest_wall" in page
    assert "<script" not in page
