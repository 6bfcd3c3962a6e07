"""The fuzzer finds every kind of fault, and no fault where there is none."""

import pytest

from benchmarks.fuzz.parser import make_input
from benchmarks.fuzz.registry import parser_at
from benchmarks.fuzz.supervisor import run_inputs

FAULTY = "tests.fuzz.faulty_parsers"


def run(name: str, last: int = 1, max_input_s: float = 2.0):
    address = f"{FAULTY}:{name}"
    return run_inputs(address, seed=1, first=0, last=last, max_input_s=max_input_s)


@pytest.mark.parametrize(("name", "values", "errors"), [("accepts", 20, 0), ("refuses", 0, 20)])
def test_value_and_typed_error_are_counted(name, values, errors):
    done = run(name, last=20)
    assert (done.findings, done.progress.next) == ([], 20)
    assert (done.progress.values, done.progress.errors) == (values, errors)


@pytest.mark.parametrize(
    ("name", "kind"),
    [
        ("raises", "untyped"),
        ("prints", "printed"),
        ("fills", "memory"),
        ("dies", "crash"),
        ("unnamed", "unnamed"),
    ],
)
def test_fault_is_a_finding(name, kind):
    done = run(name)
    assert [(finding.number, finding.outcome.kind) for finding in done.findings] == [(0, kind)]
    assert done.progress.next == 1


def test_memory_of_a_mutation_is_not_that_of_the_parser():
    done = run("mutator_fills", last=2)
    assert (done.findings, done.progress.values) == ([], 2)
    assert done.progress.peak_bytes < 1 << 30


@pytest.mark.parametrize("name", ["spins", "blocks"])
def test_input_that_does_not_return_is_ended(name):
    done = run(name, last=3, max_input_s=0.3)
    assert [(finding.number, finding.outcome.kind) for finding in done.findings] == [(0, "slow")]
    assert done.progress.next == 1


def test_inputs_after_a_crash_are_run():
    done = run("dies_at_first", last=1)
    assert [(each.number, each.outcome.kind) for each in done.findings] == [(0, "crash")]
    address = f"{FAULTY}:dies_at_first"
    done = run_inputs(address, seed=1, first=done.progress.next, last=5)
    assert (done.findings, done.progress.next) == ([], 5)


def test_worker_that_ends_before_its_first_input_is_a_finding_of_that_input():
    address = f"{FAULTY}:has_no_seeds"
    done = run_inputs(address, seed=1, first=7, last=9)
    assert [(each.number, each.outcome.kind) for each in done.findings] == [(7, "crash")]
    assert done.progress.next == 8


def test_mutator_that_raises_leaves_the_document():
    parser = parser_at(f"{FAULTY}:mutator_raises")
    assert make_input(parser, [b"seed"], 1, 5) == b"seed"


def test_inputs_can_be_made_again():
    parser = parser_at(f"{FAULTY}:accepts")
    first = [make_input(parser, parser.seeds(), 1, number) for number in range(50)]
    assert first == [make_input(parser, parser.seeds(), 1, number) for number in range(50)]
    assert first[0] == b"seed"
    assert len(set(first)) > 10
    assert first != [make_input(parser, parser.seeds(), 2, number) for number in range(50)]
