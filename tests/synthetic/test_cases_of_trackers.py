"""Cases of every tracker replay with all their expectations; the truth is of the simulation."""

import json

import pytest
import yaml

from app.cli.main import main

CASES = [
    # tracker, seed, further options
    *(("aurora", seed, ["--duration", "50", "--tumor-mm", "12"]) for seed in (1, 2)),
    *(("trakstar", seed, ["--duration", "50", "--tumor-mm", "20"]) for seed in (1, 2)),
    *(("polaris", seed, ["--duration", "50", "--tumor-mm", "8"]) for seed in (1, 2)),
    ("aurora", 3, ["--duration", "180", "--tumor-mm", "15"]),
]


@pytest.mark.timeout(900)  # with the compilation of the kernels, on a busy machine
@pytest.mark.parametrize(("tracker", "seed", "more"), CASES)
def test_every_expectation_of_a_made_case_holds(tracker, seed, more, tmp_path):
    case, out = tmp_path / "case", tmp_path / "report"
    assert main(["make-case", str(case), "--tracker", tracker, "--seed", str(seed), *more]) == 0
    assert main(["replay", str(case), "--no-ros", "--report", str(out)]) == 0
    summary = json.loads((out / "summary.json").read_text())
    assert {check["result"] for check in summary["expected"]} == {"pass"}
    expected = yaml.safe_load((case / "expected.yaml").read_text())
    assert [b["shaft_only"] for b in expected["breaches"]["intervals"]] == [False, False, True]
    assert len(summary["breaches"]) == 3
