"""Run rows of the fault matrix, one after the other, on one bench."""

import sys
from collections.abc import Iterator, Sequence
from fnmatch import fnmatch
from pathlib import Path
from typing import Any

from benchmarks.faults.bench import Bench, GuardStartError, UnmeasuredError
from benchmarks.faults.display_rows import display_rows
from benchmarks.faults.foreign_rows import foreign_rows
from benchmarks.faults.guard_rows import guard_rows
from benchmarks.faults.results import COLUMNS, Row, RowResult, Variant
from benchmarks.faults.tracker_rows import tracker_rows
from benchmarks.harness.figures import columns_table, load, show, write_json
from benchmarks.harness.processes import ChildError

MAX_ATTEMPTS = 5  # a trial is repeated so often if its effect could not be separated from another


def run(options: Any, folder: Path) -> int:
    rows = selected(options.rows)
    if options.list or not rows:
        print("\n".join(row.label for row in rows) or "no row has such a name; see --list")
        return 0 if rows else 2
    bench = Bench(folder, options.constraint_hz, options.stale_ms)
    documents: list[dict[str, Any]] = []
    passed = True
    try:
        for result in run_rows(bench, rows, options.trials):
            print(f"{result.row.label}: {result.outcome}", flush=True)
            passed = passed and result.passed
            documents.append(result.document())
            write_json(options.json, {"rows": documents})
    except GuardStartError as error:
        print(f"marginguard: error: {error}", file=sys.stderr)
        return 1
    finally:
        bench.close()
    title = f"{options.trials} trials per row; load {load():.1f}"
    show(columns_table(title, documents, COLUMNS, left=9), width=250)
    return 0 if passed else 1


def all_rows() -> list[Row]:
    """The whole matrix, ordered so that a guard serves as many rows as possible."""
    order = list(Variant)
    rows = [*tracker_rows(), *foreign_rows(), *display_rows(), *guard_rows()]
    return sorted(rows, key=lambda row: order.index(row.variant))


def selected(patterns: Sequence[str]) -> list[Row]:
    """Rows whose label contains one of ``patterns`` or matches it as a wildcard; all without."""
    rows = all_rows()
    if not patterns:
        return rows
    return [
        row
        for row in rows
        if any(each in row.label or fnmatch(row.label, each) for each in patterns)
    ]


def run_rows(bench: Bench, rows: Sequence[Row], trials: int) -> Iterator[RowResult]:
    """Run each row ``trials`` times, or as often as it declares; yield the results."""
    for row in rows:
        result = RowResult(row)
        for _ in range(row.trials or trials):
            if not _trial(bench, row, result):
                break
        if row.restarts and bench.guard is not None:
            bench.guard.end()
        yield result


def _trial(bench: Bench, row: Row, result: RowResult) -> bool:
    """Add one trial to ``result``; False if the row needs no further one."""
    why = ""
    for _ in range(MAX_ATTEMPTS):
        try:
            bench.prepare(
                robot=row.variant is not Variant.NO_ROBOT, joints=row.variant is Variant.LIVE_JOINTS
            )
            result.trials.append(row.run(bench))
            return True
        except (UnmeasuredError, ChildError) as error:
            why = str(error)
            if row.variant is Variant.SILENT_JOINTS and "redundancy_lost" in why:
                result.held_before = "on hold before the fault: redundancy_lost"
                return False
            print(f"  {row.label}: {why}", file=sys.stderr)
    result.unmeasured.append(why)
    return True
