"""The C++ rule of a controller in closed loops, and compiled with sanitizers."""

import subprocess

import numpy as np
import pytest

from tests.examples.cpp_rule import answers, check_closed_loops, compiled
from tests.examples.rule_cases import LONG, STEPS, Allow, Start, events
from tests.fixture.control.closed_loops import TUMORS

pytestmark = pytest.mark.long

SANITIZED = ["-g", "-O1", "-fsanitize=address,undefined", "-fno-sanitize-recover=all"]


@pytest.mark.parametrize("tumor_kind", TUMORS)
def test_cpp_rule_decides_as_the_python_rule_in_closed_loops(cpp_driver, tumor_kind, project_root):
    check_closed_loops(cpp_driver, tumor_kind, project_root, steps=60)


def test_cpp_rule_has_no_undefined_behaviour(cpp_sources, tmp_path):
    (tmp_path / "empty.cpp").write_text("int main() {}\n")
    empty = ["g++", *SANITIZED, str(tmp_path / "empty.cpp"), "-o", str(tmp_path / "empty")]
    if subprocess.run(empty, check=False).returncode != 0:
        pytest.skip("g++ has no sanitizers")
    driver = compiled(cpp_sources, tmp_path / "driver", *SANITIZED)
    lives = [list(events(np.random.default_rng(seed))) for seed in range(1000, 1020)]
    lives.append(list(events(np.random.default_rng(1020), LONG)))
    absurd_ns = (0, 2**63 - 1, -(2**63), 2**63 - 1, 0)
    lives.append([Start(), *(Allow(np.zeros(6), np.zeros(3), now_ns) for now_ns in absurd_ns)])
    found = answers(driver, lives)
    assert len(found) == (20 * 12 + LONG) * STEPS + len(absurd_ns)
    reasons = [line.split()[1] for line in found[-len(absurd_ns) :]]
    assert reasons == ["no_message", "no_message", "clock", "clock", "clock"]
