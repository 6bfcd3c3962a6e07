"""Replay many cases on the workers of Dask distributed; write one Parquet dataset and a report.

COHORT is a folder of cases, a list of paths and URLs, a URL, or the manifest of 'make-case cohort'.
A finished case is not done again unless its input or the version has changed. A case that fails is
a row with its reason. Exit status: 0; 1 when a case failed; 2 on bad input.
"""

import argparse
import os
import sys
from typing import TYPE_CHECKING

from app import __version__
from app.cli.options import add_json, folder_path, integer
from app.cli.progress import progress_with_total
from app.files import write_file
from app.geometry import InputError

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from app.cli.cohort_run import Job, Outcome
    from app.cohort import Dataset

SUMMARY = "replay many cases at once, write a dataset and a report"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of ``marginguard cohort``."""
    parser.add_argument("cohort", metavar="COHORT", help="folder, list, URL or manifest")
    parser.add_argument(
        "--out", type=folder_path, required=True, metavar="DIR", help="folder of the results"
    )
    parser.add_argument(
        "--scheduler",
        metavar="ADDRESS",
        help="address of a Dask scheduler, tcp://HOST:PORT or tls://HOST:PORT (default: workers on "
        "this machine)",
    )
    parser.add_argument(
        "--workers",
        type=integer(1, 1024),
        metavar="N",
        help="workers on this machine (default: one for each processor)",
    )
    parser.add_argument(
        "--tip-only",
        action="store_true",
        help="measure the tool of every case by its tip alone, as for a needle without a mesh",
    )
    add_json(parser)


def run(options: argparse.Namespace) -> int:
    """Run the cohort."""
    import json
    from dataclasses import replace

    from app.cli.cohort_run import CohortRun
    from app.cli.dask_pool import DaskPool
    from app.cohort import Dataset, open_cohort

    if options.scheduler is not None and options.workers is not None:
        raise InputError("--workers: with --scheduler; expected one of them")
    cohort = replace(open_cohort(options.cohort), tip_only=options.tip_only)
    dataset = Dataset(options.out)
    cohort_run = CohortRun(cohort, dataset, __version__)
    workers = options.workers or len(os.sched_getaffinity(0))

    with progress_with_total("running case") as report:

        def run_jobs(jobs: "Iterable[Job]") -> "Iterator[tuple[Job, Outcome]]":
            with DaskPool(options.scheduler, workers) as pool:
                print(f"Dask's dashboard: {pool.dashboard}", file=sys.stderr, flush=True)
                yield from pool.run(jobs)

        counts = cohort_run.run(run_jobs, report)
    _write_report(dataset, cohort.name)
    if options.json:
        names = ("total", "kept", "done", "failed")
        print(json.dumps({name: getattr(counts, name) for name in names}))
    else:
        print(
            f"{counts.total} cases: {counts.done} done, {counts.kept} kept, "
            f"{counts.failed} with an error; wrote {options.out}"
        )
    return 1 if counts.failed else 0


def _write_report(dataset: "Dataset", name: str) -> None:
    """Write ``report.html`` and ``comparison.csv`` of all rows."""
    from app.cohort import compare, comparison_csv, find_outliers, groups_of
    from app.report.cohort_html import cohort_html, forest_png

    rows = list(dataset.rows())
    groups = groups_of(rows)
    comparisons = compare(rows, (groups[0], groups[1])) if len(groups) == 2 else ()
    forest = forest_png(comparisons) if comparisons else None
    page = cohort_html(name, rows, comparisons, find_outliers(rows), forest, __version__)
    write_file(dataset.folder / "report.html", page.encode())
    write_file(dataset.folder / "comparison.csv", comparison_csv(comparisons).encode())
