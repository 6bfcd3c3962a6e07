"""A running live session is stopped 100 times at random moments, while commands arrive."""

import pytest

from tests.benchmarks.bench_run import run

pytestmark = pytest.mark.exhaustive


@pytest.mark.parametrize("round_of_25", range(4))
def test_nothing_is_permissive_after_a_stop(tmp_path, round_of_25):
    """From outside: SIGSTOP for 0.3 to 2 s, longer than data are valid, to a guard at 1 kHz.

    Tracker and controller go on meanwhile, so that samples and commands wait in the buffers.
    """
    options = ("--rows", "guard stopped", "--stale-ms", "200")
    done, (row,) = run("faults", tmp_path / "stops.json", *options, timeout_s=600)
    assert row["trials"] == 25, done.stdout + done.stderr
    assert (row["late_constraints"], row["late_twists"]) == (0, 0), done.stdout
