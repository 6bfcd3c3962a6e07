"""Findings of earlier fuzzing stay mended, and a short run over all parsers has none."""

from pathlib import Path

import pytest

from tests.fuzz.outcome import VALUE
from tests.fuzz.parsers import PARSERS
from tests.fuzz.worker import MAX_CPU_S, Fuzzer

pytestmark = pytest.mark.slow

REGRESSIONS = Path(__file__).parent / "regressions"
INPUTS = 30
FEW_INPUTS = {"xacro": 8}
"""Number of inputs of slow parsers: many of these inputs compute until their limit."""


@pytest.fixture(scope="module")
def fuzzer():
    # On a busy machine the same work takes several times the processor time.
    with Fuzzer("tests.fuzz.parsers", max_cpu_s=5.0 * MAX_CPU_S) as fuzzer:
        yield fuzzer


def test_every_folder_of_regressions_belongs_to_a_parser():
    assert {folder.name for folder in REGRESSIONS.iterdir()} <= set(PARSERS)


@pytest.mark.parametrize("name", sorted(PARSERS))
def test_seeds_are_read(fuzzer, name):
    for data in PARSERS[name].documents:
        assert fuzzer.run(name, data).kind == VALUE


@pytest.mark.parametrize("name", sorted(PARSERS))
def test_mended_findings_and_new_inputs_have_a_value_or_a_typed_error(fuzzer, name):
    folder = REGRESSIONS / name
    inputs = {path.name: path.read_bytes() for path in folder.glob("*")}
    inputs |= {
        f"input {number}": PARSERS[name].input(7, number)
        for number in range(FEW_INPUTS.get(name, INPUTS))
    }
    outcomes = {each: fuzzer.run(name, data) for each, data in inputs.items()}
    assert {each: found for each, found in outcomes.items() if found.is_finding} == {}
