"""Cases of every tracker replay with all their expectations; the truth is of the simulation."""

import json
import re

import numpy as np
import pytest
import yaml

from app.case import open_case
from app.cli.main import main
from tests.shipped_case import BREACHES, SHIPPED_CASE

pytestmark = pytest.mark.long

STRUCTURES_CASE = SHIPPED_CASE.parent / "structures_case"


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
@pytest.mark.parametrize("shipped_case", [SHIPPED_CASE, STRUCTURES_CASE], ids=["one", "several"])
def test_shipped_case_is_made_again_by_the_command_in_its_readme(tmp_path, shipped_case):
    """With other versions of libraries the numbers differ by rounding, and by a step at most."""
    readme = (shipped_case / "README.md").read_text()
    (words,) = re.findall(r"^marginguard (make-case DIR .*)$", readme, re.MULTILINE)
    case = tmp_path / "case"
    assert main([str(case) if word == "DIR" else word for word in words.split()]) == 0
    made, shipped = (
        yaml.safe_load((folder / "expected.yaml").read_text()) for folder in (case, shipped_case)
    )
    assert made["dropouts"] == shipped["dropouts"] and made["frames"] == shipped["frames"]
    for found, true in zip(made["breaches"]["intervals"], BREACHES, strict=True):
        assert found == pytest.approx(true, abs=1e-3)
    further = [folder.get("structures", []) for folder in (made, shipped)]
    for found, true in zip(*further, strict=True):
        assert found["name"] == true["name"]
        intervals = [each["breaches"]["intervals"] for each in (found, true)]
        for here, there in zip(*intervals, strict=True):
            assert here == pytest.approx(there, abs=1e-3)
    opened = [open_case(folder) for folder in (case, shipped_case)]
    meshes = [
        [each.structure_mesh(entry).vertices_mm for entry in each.manifest.structures]
        for each in opened
    ]
    assert len(meshes[0]) == len(further[0])
    for found, true in zip(*meshes, strict=True):
        np.testing.assert_allclose(found, true, atol=1e-3)
    poses = [list(each.recorded_frames()) for each in opened]
    for found, true in zip(*poses, strict=True):
        assert found.stamp == true.stamp
        for here, there in zip(found.poses, true.poses, strict=True):
            assert here.status is there.status
            if here.transform is not None and there.transform is not None:
                assert here.transform.distance_mm_to(there.transform) < 0.02
