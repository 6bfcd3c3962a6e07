"""The Parquet dataset and its journal: fixed bytes, resumption, a disk that is full."""

import json
import resource
import signal

import pyarrow.parquet as pq
import pytest

from app.cohort import CohortCase, Dataset, failed, identity_of
from app.cohort.columns import COLUMNS, FAILED, LOST, OK
from app.cohort.dataset import JOURNAL, SCHEMA, partition_bytes
from app.geometry import InputError


def row(name, status=OK, digest="h", **values):
    made = identity_of(CohortCase(name, "source"), digest, "1") | {"status": status}
    return made | values


def test_partition_holds_every_column_with_its_type(tmp_path):
    rows = [row("a", frames=3, duration_s=1.5, registration_accepted=True), row("b", FAILED)]
    path = tmp_path / "x.parquet"
    path.write_bytes(partition_bytes(rows))
    table = pq.read_table(path)
    assert table.schema.equals(SCHEMA) and table.column_names == list(COLUMNS)
    assert table.to_pylist() == rows
    assert partition_bytes(rows) == path.read_bytes()


def test_finished_case_is_found_by_name_input_and_version(tmp_path):
    dataset = Dataset(tmp_path / "out")
    dataset.open()
    dataset.write_partition(0, [row("a"), row("b", FAILED), row("c", LOST)], [])
    finished = dataset.open()
    assert finished.get("a", "h", "1") == row("a")
    assert finished.get("b", "h", "1") == row("b", FAILED)
    for name, digest, version in (
        ("c", "h", "1"),
        ("a", "x", "1"),
        ("a", "h", "2"),
        ("d", "h", "1"),
    ):
        assert finished.get(name, digest, version) is None


def test_journal_survives_a_crash_and_a_cut_line(tmp_path):
    dataset = Dataset(tmp_path)
    dataset.open()
    dataset.append(row("a"))
    dataset.append(row("b"))
    with (tmp_path / JOURNAL).open("a") as file:
        file.write('{"name": "c", "sta')
    finished = dataset.open()
    assert finished.get("b", "h", "1") == row("b") and finished.get("c", "h", "1") is None
    dataset.append(row("d"))
    assert dataset.open().get("d", "h", "1") == row("d")


def test_written_partition_leaves_only_pending_rows_in_the_journal(tmp_path):
    dataset = Dataset(tmp_path)
    dataset.open()
    for name in "abc":
        dataset.append(row(name))
    dataset.write_partition(0, [row("a"), row("b")], [row("c")])
    lines = (tmp_path / JOURNAL).read_text().splitlines()
    assert [json.loads(line)["name"] for line in lines] == ["c"]
    assert [each["name"] for each in dataset.rows()] == ["a", "b"]
    dataset.write_partition(1, [row("c")], [])
    dataset.close(2)
    assert not (tmp_path / JOURNAL).exists() and len(dataset.partitions) == 2
    dataset.close(1)
    assert [path.name for path in dataset.partitions] == ["part-00000.parquet"]


def test_cut_or_foreign_partition_counts_as_not_done(tmp_path):
    dataset = Dataset(tmp_path)
    dataset.open()
    dataset.write_partition(0, [row("a")], [])
    dataset.partition(1).write_bytes(dataset.partition(0).read_bytes()[:-20])
    dataset.partition(2).write_text("not Parquet")
    assert dataset.open().get("a", "h", "1") == row("a")
    assert [each["name"] for each in dataset.rows()] == ["a"]


@pytest.fixture
def full_disk():
    """No file can grow beyond 2000 bytes: writes fail as on a full disk (EFBIG)."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    ignored = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (2000, before[1]))
    yield
    resource.setrlimit(resource.RLIMIT_FSIZE, before)
    signal.signal(signal.SIGXFSZ, ignored)


def test_full_disk_leaves_no_half_row_and_no_half_partition(tmp_path, full_disk):
    dataset = Dataset(tmp_path)
    dataset.open()
    written = 0
    with pytest.raises(InputError, match="cannot be written"):
        for written in range(100):
            dataset.append(row(f"case_{written}"))
    assert written > 0
    text = (tmp_path / JOURNAL).read_text()
    assert text.count("\n") == written and text.endswith("\n")
    with pytest.raises(InputError, match="cannot be written"):
        dataset.write_partition(0, [row(f"case_{index}") for index in range(100)], [])
    assert dataset.partitions == [] and [path.name for path in (tmp_path / "cases").iterdir()] == []


def test_reason_of_a_failure_is_one_line():
    assert failed(row("a"), FAILED, "one\n two\t three")["reason"] == "one two three"
