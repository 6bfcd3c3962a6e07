"""The results of a cohort as one Parquet dataset: fixed partitions, and a journal while it runs.

A partition holds a fixed number of cases in the order of the cohort and is written at once. Its
bytes depend on its rows alone: not on the order in which workers finish, nor on their number.
"""

import json
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from app.cohort.columns import COLUMNS, LOST, Row
from app.files.atomic_io import write_file, writing

PARTITION_CASES = 64
CASES_FOLDER = "cases"
JOURNAL = "journal.jsonl"

_TYPES = {
    "text": pa.string(),
    "integer": pa.int64(),
    "number": pa.float64(),
    "boolean": pa.bool_(),
}
SCHEMA = pa.schema([pa.field(name, _TYPES[kind]) for name, kind in COLUMNS.items()])


def partition_bytes(rows: Sequence[Row]) -> bytes:
    """The Parquet file of ``rows``: the same rows give the same bytes."""
    table = pa.Table.from_pylist(list(rows), schema=SCHEMA)
    sink = pa.BufferOutputStream()
    pq.write_table(table, sink, compression="zstd")
    return bytes(sink.getvalue())


class FinishedRows:
    """Rows of earlier runs by the name of their case, kept in columns."""

    def __init__(self, tables: Iterable[pa.Table], journal: Iterable[Row] = ()) -> None:
        found = list(tables)
        self._table = pa.concat_tables(found) if found else SCHEMA.empty_table()
        names = self._table.column("name").to_pylist()
        self._places = {name: place for place, name in enumerate(names)}
        self._journal = {str(row["name"]): row for row in journal}

    def get(self, name: str, input_hash: str, version: str) -> Row | None:
        """The row of the case ``name``, if it was finished with this input and this version."""
        row = self._journal.get(name)
        if row is None and name in self._places:
            (row,) = self._table.slice(self._places[name], 1).to_pylist()
        if row is None or row["status"] == LOST:
            return None
        same = row["input_hash"] == input_hash and row["version"] == version
        return row if same else None


class Dataset:
    """The folder of a cohort's results. For one writer."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._journal = folder / JOURNAL

    @property
    def partitions(self) -> list[Path]:
        """The files of the dataset, in order."""
        return sorted((self.folder / CASES_FOLDER).glob("part-*.parquet"))

    def open(self) -> FinishedRows:
        """Create the folder where it is missing; read what earlier runs have finished."""
        with writing(self.folder):
            (self.folder / CASES_FOLDER).mkdir(parents=True, exist_ok=True)
            self._end_last_line()
        return FinishedRows(self._tables(), self._journal_rows())

    def append(self, row: Row) -> None:
        """Add the row of a finished case to the journal; raises `InputError` and leaves no half."""
        line = json.dumps(row, allow_nan=False).encode() + b"\n"
        with writing(self._journal), self._journal.open("ab", buffering=0) as file:
            size = file.tell()
            try:
                written = file.write(line)
                if written != len(line):
                    raise OSError(28, "No space left on device")
            except OSError:
                file.truncate(size)
                raise

    def write_partition(self, number: int, rows: Sequence[Row], pending: Iterable[Row]) -> None:
        """Write a partition whose cases are all done; ``pending`` rows stay in the journal."""
        path = self.partition(number)
        content = partition_bytes(rows)
        if not path.is_file() or path.read_bytes() != content:
            write_file(path, content)
        if self._journal.exists():
            lines = (json.dumps(row, allow_nan=False) + "\n" for row in pending)
            write_file(self._journal, "".join(lines).encode())

    def close(self, partitions: int) -> None:
        """Remove the journal, and partitions beyond the number of this cohort."""
        self._journal.unlink(missing_ok=True)
        for path in self.partitions[partitions:]:
            path.unlink()

    def rows(self) -> Iterator[Row]:
        """Yield all rows of the dataset in order."""
        for table in self._tables():
            yield from table.to_pylist()

    def partition(self, number: int) -> Path:
        """The file of a partition."""
        return self.folder / CASES_FOLDER / f"part-{number:05d}.parquet"

    def _tables(self) -> Iterator[pa.Table]:
        for path in self.partitions:
            try:
                table = pq.read_table(path, partitioning=None)
            except (pa.ArrowInvalid, OSError):
                continue  # not a file of ours, or cut: its cases are done again
            if table.schema.equals(SCHEMA):
                yield table

    def _end_last_line(self) -> None:
        """Remove the part of a line that a crash has left at the end of the journal."""
        if not self._journal.is_file():
            return
        with self._journal.open("r+b") as file:
            content = file.read()
            file.truncate(content.rfind(b"\n") + 1)

    def _journal_rows(self) -> Iterator[Row]:
        if not self._journal.is_file():
            return
        with self._journal.open(encoding="utf-8") as file:
            for line in file:
                try:
                    row: Any = json.loads(line)
                except ValueError:
                    continue
                if isinstance(row, dict) and row.keys() == COLUMNS.keys():
                    yield dict(row)
