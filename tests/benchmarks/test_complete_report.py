from typing import Any

from benchmarks.complete_report import compared


def a_run(wall_s: float, cpu_s: float) -> dict[str, Any]:
    return {"wall_s": wall_s, "cpu_s": cpu_s, "parts_s": {"analyse the steps": wall_s - 1.0}}


def test_fastest_run_of_each_counts() -> None:
    replays = [a_run(4.5, 4.0), a_run(4.0, 3.5)]
    complete = [a_run(8.0, 15.0), a_run(7.5, 14.5), a_run(9.0, 14.0)]
    found = compared(replays, complete)
    assert (found["beyond_s"], found["beyond_cpu_s"]) == (3.5, 11.0)
    assert found["complete"]["parts_s"] == {"analyse the steps": 6.5}
    assert found["walls_s"]["complete"] == [8.0, 7.5, 9.0]
