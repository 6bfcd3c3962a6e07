"""A run of a cohort without Dask: resumption, failures, partitions. Jobs run in this process."""

import csv
import os
import re
import socket
from dataclasses import replace

import pytest

from app import __version__
from app.cli.cohort_run import CohortRun, Job, run_job
from app.cohort import Cohort, CohortCase, Dataset, finished, identity_of, input_hash
from app.cohort.columns import ANALYSIS, COLUMNS, INSERTION
from app.geometry import InputError
from tests.cli.small_case import write_small_case

pytestmark = pytest.mark.long


class HereAndNow:
    """Test double of the pool: runs jobs in this process, in reverse order, and counts them."""

    def __init__(self):
        self.names = []

    def __call__(self, jobs):
        for job in reversed(list(jobs)):
            self.names.append(job.case.name)
            yield job, run_job(job)


@pytest.fixture
def cohort(tmp_path):
    write_small_case(tmp_path / "a")
    write_small_case(tmp_path / "b", lambda manifest: manifest.update(name="other"))
    cut = write_small_case(tmp_path / "c")
    recording = cut / "tracking.igs.mha"
    recording.write_bytes(recording.read_bytes()[:200])
    cases = [CohortCase(name, str(tmp_path / name), group="g") for name in ("a", "b", "c", "none")]
    return Cohort("test", recorded=tuple(cases))


def run(cohort, folder, partition_cases=3):
    pool = HereAndNow()
    dataset = Dataset(folder)
    counts = CohortRun(cohort, dataset, __version__, partition_cases=partition_cases).run(pool)
    return counts, pool.names, {row["name"]: row for row in dataset.rows()}


def contents(folder):
    return {path.name: path.read_bytes() for path in (folder / "cases").iterdir()}


def test_failing_case_is_a_row_with_its_reason(cohort, tmp_path):
    counts, _, rows = run(cohort, tmp_path / "out")
    assert (counts.total, counts.done, counts.kept, counts.failed) == (4, 4, 0, 2)
    assert list(rows) == ["a", "b", "c", "none"]
    assert rows["a"]["status"] == "ok" and rows["a"]["frames"] == 40 and rows["a"]["breaches"] == 1
    assert rows["a"]["min_signed_distance_mm"] == pytest.approx(-3.0, abs=0.1)
    # Three steps end with the side of the rod in the ball: its tip stays outside.
    assert rows["a"]["tissue_path_mm"] == 0.0 and rows["c"]["tissue_path_mm"] is None
    assert rows["a"]["tissue_damage_mm2"] == 0.0 and rows["c"]["tissue_damage_mm2"] is None
    assert rows["c"]["status"] == "failed" and "tracking.igs.mha" in rows["c"]["reason"]
    assert rows["none"]["reason"].endswith("no such folder; expected a case folder")
    assert sorted(contents(tmp_path / "out")) == ["part-00000.parquet", "part-00001.parquet"]
    with (tmp_path / "out" / "times.csv").open() as file:
        costs = list(csv.DictReader(file))
    assert {row["name"] for row in costs} == {"a", "b", "c"}  # the folder of the fourth is missing
    assert {row["worker"] for row in costs} == {f"{socket.gethostname()}:{os.getpid()}"}


def test_tool_without_a_mesh_is_measured_by_its_tip_on_request(tmp_path):
    write_small_case(tmp_path / "needle", lambda manifest: manifest["tool"].pop("mesh"))
    whole = Cohort("needles", recorded=(CohortCase("needle", str(tmp_path / "needle")),))
    _, _, rows = run(whole, tmp_path / "out")
    assert (rows["needle"]["status"], rows["needle"]["tip_only"]) == ("failed", False)
    tips = replace(whole, tip_only=True)
    counts, names, rows = run(tips, tmp_path / "out")
    assert (counts.kept, names) == (0, ["needle"])
    row = rows["needle"]
    assert (row["status"], row["tip_only"], row["frames"]) == ("ok", True, 40)
    assert row["min_signed_distance_mm"] > 0.0 and row["tissue_s"] == 0.0  # the tip stays outside
    assert run(tips, tmp_path / "out")[1] == []


@pytest.mark.parametrize(("middle_mm", "damage_mm2"), [(4.0, 12.5), (None, None)])
def test_tissue_damage_is_unknown_without_a_distance(middle_mm, damage_mm2):
    keys = ["frames", "valid_frames", "inside_frames", "duration_s", "min_signed_distance_mm"]
    keys += ["path_min_signed_distance_mm", "path_lower_bound_mm"]
    seconds = dict.fromkeys(("NEGATIVE", "WARNING", "POSITIVE", "UNKNOWN"), 0.0)
    summary = dict.fromkeys(keys, 0) | {"state_seconds": seconds, "breaches": [], "notes": []}
    summary |= {"registration": None, "expected": None}
    texts = ("deepest_direction", "deepest_part")
    analysis = dict.fromkeys([*ANALYSIS.values(), *INSERTION.values(), *texts])
    analysis |= {"distance_p50_mm": middle_mm, "insertion_tissue_damage_mm2": 12.5}
    row = finished(identity_of(CohortCase("a", "a"), "", "1"), summary, analysis)
    assert row["status"] == "ok" and row["tissue_damage_mm2"] == damage_mm2
    assert row.keys() == COLUMNS.keys()


def test_second_run_does_nothing_and_changes_no_byte(cohort, tmp_path):
    run(cohort, tmp_path / "out")
    before = contents(tmp_path / "out")
    counts, names, _ = run(cohort, tmp_path / "out")
    assert names == [] and counts.kept == 3 and contents(tmp_path / "out") == before


def test_changed_input_and_another_version_are_done_again(cohort, tmp_path):
    run(cohort, tmp_path / "out")
    (tmp_path / "b" / "note.txt").write_text("new")
    assert run(cohort, tmp_path / "out")[1] == ["b"]
    pool = HereAndNow()
    CohortRun(cohort, Dataset(tmp_path / "out"), "0.0.1", partition_cases=3).run(pool)
    assert sorted(pool.names) == ["a", "b", "c"]
    # Workers of another version than the client give no results.
    statuses = {row["status"] for row in Dataset(tmp_path / "out").rows() if row["name"] != "none"}
    assert statuses == {"lost"}


def test_inserted_case_and_new_group_keep_the_others(cohort, tmp_path):
    run(cohort, tmp_path / "out")
    write_small_case(tmp_path / "0")
    first, *others = cohort.recorded
    more = Cohort("test", recorded=(CohortCase("0", str(tmp_path / "0")), first, *others))
    _, names, rows = run(more, tmp_path / "out")
    assert names == ["0"] and list(rows) == ["0", "a", "b", "c", "none"]
    renamed = Cohort("test", recorded=(CohortCase("a", first.source, group="new"),))
    _, names, rows = run(renamed, tmp_path / "out")
    assert names == [] and list(rows) == ["a"] and rows["a"]["group"] == "new"


def test_interrupted_run_continues_from_its_journal_with_the_same_bytes(cohort, tmp_path):
    def stops(jobs):
        (job,) = list(jobs)[:1]
        yield job, run_job(job)
        raise InputError("the scheduler went away")

    with pytest.raises(InputError, match="went away"):
        CohortRun(cohort, Dataset(tmp_path / "out"), __version__, partition_cases=3).run(stops)
    assert sorted(contents(tmp_path / "out")) == ["part-00001.parquet"]
    assert run(cohort, tmp_path / "out")[1] == ["c", "b"]
    run(cohort, tmp_path / "other")
    assert contents(tmp_path / "out") == contents(tmp_path / "other")


def test_folder_in_use_is_refused(cohort, tmp_path):
    def nested(jobs):
        with pytest.raises(InputError, match="in use by another run"):
            run(cohort, tmp_path / "out")
        yield from ((job, run_job(job)) for job in jobs)

    CohortRun(cohort, Dataset(tmp_path / "out"), __version__).run(nested)


def test_worker_without_space_is_a_lost_case(cohort, tmp_path, monkeypatch):
    def full(folder):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("app.cli.cohort_run._results", full)
    case = cohort.recorded[0]
    outcome = run_job(Job(case, input_hash(case), __version__))
    assert (outcome.row["status"], outcome.row["reason"]) == (
        "lost",
        "OSError: No space left on device",
    )


@pytest.mark.parametrize("frame", [20, 25, 30])
def test_clock_that_overlaps_itself_adds_no_time(tmp_path, frame):
    """From ``frame`` on the stamps are half a second early: ten of them occur twice."""
    folder = write_small_case(tmp_path / "case")
    recording = folder / "tracking.igs.mha"

    def early(match):
        index, time_s = int(match[1]), float(match[2])
        return f"Seq_Frame{index:04}_Timestamp = {time_s - 0.5 * (index >= frame):.3f}"

    stamps = r"Seq_Frame(\d+)_Timestamp = ([\d.]+)"
    recording.write_text(re.sub(stamps, early, recording.read_text()))
    case = CohortCase("a", str(folder))
    row = run_job(Job(case, input_hash(case), __version__)).row
    assert (row["status"], row["frames"], row["inside_frames"]) == ("ok", 40, 3)
    # 39 steps of 50 ms, one of them back. After it poses are unknown until they have recovered.
    assert row["duration_s"] == pytest.approx(38 * 0.05)
    states = sum(row[f"{state}_s"] for state in ("negative", "warning", "positive", "unknown"))
    assert states == pytest.approx(row["duration_s"])
    assert row["unknown_s"] == pytest.approx(0.15)
    # Within 5 mm from frame 15 to 25, whether or not the clock jumps there.
    assert row["cutting_s"] == pytest.approx(0.55, abs=0.051)
