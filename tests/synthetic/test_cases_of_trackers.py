"""Cases of every tracker replay with all their expectations; the truth is of the simulation."""

import json
import re

import pytest
import yaml

from app.case import open_case
from app.cli.main import main
from tests.shipped_case import BREACHES, SHIPPED_CASE

pytestmark = pytest.mark.long

README = SHIPPED_CASE / "README.md"


def check_made_case(tracker, seed, more, folder):
    case, out = folder / "case", folder / "report"
    assert main(["make-case", str(case), "--tracker", tracker, "--seed", str(seed), *more]) == 0
    assert main(["replay", str(case), "--no-ros", "--report", str(out)]) == 0
    summary = json.loads((out / "summary.json").read_text())
    assert {check["result"] for check in summary["expected"]} == {"pass"}
    expected = yaml.safe_load((case / "expected.yaml").read_text())
    assert [b["shaft_only"] for b in expected["breaches"]["intervals"]] == [False, False, True]
    assert len(summary["breaches"]) == 3


@pytest.mark.timeout(900)  # with the compilation of the kernels, on a busy machine
@pytest.mark.parametrize(
    ("tracker", "tumor_mm"), [("aurora", "12"), ("trakstar", "20"), ("polaris", "8")]
)
def test_every_expectation_of_a_made_case_holds(tracker, tumor_mm, tmp_path):
    check_made_case(tracker, 1, ["--duration", "50", "--tumor-mm", tumor_mm], tmp_path)


@pytest.mark.timeout(300)
def test_shipped_case_is_made_again_by_the_command_in_its_readme(tmp_path):
    """With other versions of libraries the numbers differ by rounding, and by a step at most."""
    (words,) = re.findall(r"^marginguard (make-case DIR .*)$", README.read_text(), re.MULTILINE)
    case = tmp_path / "case"
    assert main([str(case) if word == "DIR" else word for word in words.split()]) == 0
    made, shipped = (
        yaml.safe_load((folder / "expected.yaml").read_text()) for folder in (case, SHIPPED_CASE)
    )
    assert made["dropouts"] == shipped["dropouts"] and made["frames"] == shipped["frames"]
    for found, true in zip(made["breaches"]["intervals"], BREACHES, strict=True):
        assert found == pytest.approx(true, abs=1e-3)
    poses = [list(open_case(folder).recorded_frames()) for folder in (case, SHIPPED_CASE)]
    for found, true in zip(*poses, strict=True):
        assert found.stamp == true.stamp
        for here, there in zip(found.poses, true.poses, strict=True):
            assert here.status is there.status
            if here.transform is not None and there.transform is not None:
                assert here.transform.distance_mm_to(there.transform) < 0.02
