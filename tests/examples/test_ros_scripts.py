"""The ROS examples beside ``marginguard replay`` in its own domain."""

import re
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tests.examples.conftest import EXAMPLES, ROOT, TIMEOUT_S
from tests.ros_domain import reserved_domain

pytestmark = pytest.mark.long

LINES = 20

Start = Callable[..., "subprocess.Popen[str]"]


@pytest.fixture
def start(environment: dict[str, str], tmp_path: Path) -> Iterator[Start]:
    """``start("examples/x.py")``: with the variables of a new user in a domain of their own."""
    started: list[subprocess.Popen[str]] = []
    with reserved_domain() as domain:

        def run(*command: str) -> "subprocess.Popen[str]":
            process = subprocess.Popen(
                [sys.executable, *command],
                cwd=tmp_path,
                env={**environment, "ROS_DOMAIN_ID": str(domain)},
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                text=True,
            )
            started.append(process)
            return process

        yield run
        for process in started:
            process.kill()
            process.communicate()


def test_both_readers_receive_the_constraints_of_a_replay(start):
    case = ROOT / "data" / "recorded_case"
    replay = start("-m", "app.cli", "replay", str(case), "--rate", "1")
    plain = start(str(EXAMPLES / "constraint_subscriber.py"))
    reader = start(str(EXAMPLES / "read_constraint.py"))

    printed, errors = reader.communicate(timeout=TIMEOUT_S)
    assert reader.returncode == 0, errors
    assert plain.stdout is not None
    received = [plain.stdout.readline().split() for _ in range(LINES)]
    plain.send_signal(signal.SIGINT)
    _, errors = plain.communicate(timeout=TIMEOUT_S)
    assert (plain.returncode, errors) == (0, "")
    assert replay.poll() is None, "the replay was still running"

    sequence = [int(line[0]) for line in received]
    assert sequence == sorted(set(sequence)), "each constraint once, in order"
    for _, state, distance_m, unit, hold, planes in received:
        assert unit == "m"
        if state == "3":  # a lost sample of the case
            assert hold == "True"
            continue
        assert state in "012"
        assert 0.0 < float(distance_m) < 0.2
        assert int(planes) >= 1
    assert len(re.findall(r"^\d+: [A-Z]+\b", printed, re.MULTILINE)) == 10
    lines = re.findall(r"\d+: (\w+) \+(\d+\.\d+) mm, approach (\d+\.\d) mm/s", printed)
    assert len(lines) >= 8, "at most a lost sample or two"
    for state, distance_mm, approach_mm_s in lines:
        assert state in ("NEGATIVE", "WARNING")
        # Far from the tumour the hand is not limited before the first lost sample; on hold
        # after it, from 2.3 s of the case on, it may not approach.
        assert float(distance_mm) < 10.0 or float(approach_mm_s) in (0.0, 30.0)
