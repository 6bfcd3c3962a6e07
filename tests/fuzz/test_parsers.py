"""Findings of earlier fuzzing stay mended, and a short run over all parsers has none."""

from pathlib import Path

import pytest

from benchmarks.fuzz.registry import all_parsers, parser_at
from benchmarks.fuzz.supervisor import run_files

REGRESSIONS = Path(__file__).parent / "regressions"
PARSERS = all_parsers()
INPUTS = 30


def test_every_folder_of_regressions_belongs_to_a_parser():
    assert {folder.name for folder in REGRESSIONS.iterdir()} <= set(PARSERS)


@pytest.mark.parametrize("name", sorted(PARSERS))
def test_mended_findings_and_new_inputs_have_a_value_or_a_typed_error(name):
    folder = REGRESSIONS / name
    files = sorted(folder.iterdir()) if folder.exists() else []
    runs = run_files(PARSERS[name], files, inputs=INPUTS)
    names = [file.name for file in files]
    findings = [each for run in runs for each in run.findings]
    assert [(names[n] if (n := each.number) < 0 else n, each.outcome) for each in findings] == []
    counts = [(run.progress.values, run.progress.errors) for run in runs]
    assert sum(map(sum, counts)) == len(files) + INPUTS
    assert sum(values for values, _ in counts) >= len(parser_at(PARSERS[name]).seeds())
