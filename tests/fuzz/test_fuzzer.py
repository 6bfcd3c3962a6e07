"""The fuzzer finds every kind of fault, and no fault where there is none."""

import pytest

from tests.fuzz.faulty_parsers import PARSERS
from tests.fuzz.outcome import ERROR, VALUE
from tests.fuzz.parser import FuzzedParser
from tests.fuzz.worker import Fuzzer

pytestmark = pytest.mark.long

FAULTY = "tests.fuzz.faulty_parsers"


@pytest.fixture(scope="module")
def fuzzer():
    with Fuzzer(FAULTY) as fuzzer:
        yield fuzzer


@pytest.mark.parametrize(("name", "kind"), [("accepts", VALUE), ("refuses", ERROR)])
def test_value_and_typed_error_are_no_findings(fuzzer, name, kind):
    assert [fuzzer.run(name, bytes(each)).kind for each in range(20)] == [kind] * 20


@pytest.mark.parametrize("name", ["untyped", "unnamed", "lines", "printed", "memory", "crash"])
def test_fault_is_a_finding_of_its_kind_and_the_next_input_is_run(fuzzer, name):
    assert fuzzer.run(name, b"x").kind == name
    assert fuzzer.run("accepts", b"x").kind == VALUE


@pytest.mark.parametrize("name", ["spins", "blocks"])
def test_input_that_does_not_return_is_ended(name):
    with Fuzzer(FAULTY, max_cpu_s=0.2, max_wait_s=60.0 if name == "spins" else 0.5) as fuzzer:
        assert fuzzer.run(name, b"x").kind == "slow"
        assert fuzzer.run("accepts", b"x").kind == VALUE


def test_mutator_that_raises_leaves_the_document():
    def raising(data, _):
        raise UnicodeDecodeError("utf-8", data, 0, 1, "invalid")

    parser = FuzzedParser("file.bin", bytes, lambda: [b"seed"], [raising])
    assert parser.input(1, 5) == b"seed"


def test_inputs_can_be_made_again():
    first = [PARSERS["accepts"].input(1, number) for number in range(50)]
    assert first == [PARSERS["accepts"].input(1, number) for number in range(50)]
    assert first[0] == b"seed"
    assert len(set(first)) > 10
    assert first != [PARSERS["accepts"].input(2, number) for number in range(50)]
