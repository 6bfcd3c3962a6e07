from typing import Any

import pytest

from benchmarks.replay.__main__ import compared, summary

pytestmark = pytest.mark.slow


def a_run(wall_s: float) -> dict[str, Any]:
    phases = {
        "start and end": 0.5, "load the program": 1.0, "open the case": 0.25,
        "read the frames and step": wall_s - 2.0, "write the report": 0.25,
    }  # fmt: skip
    return {"wall_s": wall_s, "cpu_s": 2.0 * wall_s, "phases_s": phases}


def test_fastest_run_counts_and_inside_excludes_loading():
    found = summary([a_run(5.0), a_run(3.0), a_run(4.0)], duration_s=60.0, frames=2000)
    assert (found["wall_s"], found["walls_s"]) == (3.0, [5.0, 3.0, 4.0])
    assert found["times_real_time"] == pytest.approx(20.0)
    assert found["inside_s"] == pytest.approx(1.25)
    assert found["times_real_time_inside"] == pytest.approx(48.0)
    assert found["ms_per_frame"] == pytest.approx(0.5)
    assert found["times_real_time_of_frames"] == pytest.approx(60.0)


def test_analysis_and_waiting_for_the_picture_are_stated_apart():
    waited = a_run(5.0)
    waited["phases_s"]["wait for scene.png"] = 1.0
    waited["wall_s"] += 2.0
    waited["phases_s"]["analyse the steps"] = 2.0
    found = summary([waited], duration_s=60.0, frames=2000)
    assert found["without_picture_s"] == pytest.approx(4.0)
    assert found["times_real_time"] == pytest.approx(15.0)
    assert found["inside_s"] == pytest.approx(3.25)


def test_fastest_complete_run_is_compared_with_the_fastest_replay():
    found = compared([a_run(4.5), a_run(4.0)], [a_run(8.0), a_run(7.5), a_run(9.0)])
    assert (found["beyond_s"], found["beyond_cpu_s"]) == (3.5, 7.0)
    assert found["complete"]["phases_s"] == a_run(7.5)["phases_s"]
    assert found["walls_s"]["complete"] == [8.0, 7.5, 9.0]
