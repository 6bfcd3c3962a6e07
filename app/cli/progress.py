"""Progress of long work on a terminal: standard error shows it, a pipe or a file gets nothing."""

import sys
from collections.abc import Callable, Iterable, Iterator, Sized
from contextlib import contextmanager
from datetime import datetime, timedelta
from typing import TypeVar

Item = TypeVar("Item")
Report = Callable[[int, int | None], None]
"""Called with the number of items that are done and the total, None where it is unknown."""


def with_progress(items: Iterable[Item], what: str, *, total: int | None = None) -> Iterator[Item]:
    """Yield ``items`` and show how many are done, with a bar and the time left for a total.

    The total of a collection is its length.
    """
    if total is None and isinstance(items, Sized):
        total = len(items)
    with progress_with_total(what) as report:
        report(0, total)
        for done, item in enumerate(items, start=1):
            yield item
            report(done, total)


@contextmanager
def progress_with_total(what: str) -> Iterator[Report]:
    """Yield a `Report` that shows a bar and the time left; a spinner without a total."""
    if not sys.stderr.isatty():
        yield lambda done, total: None
        return
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        SpinnerColumn,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    with Progress(
        SpinnerColumn(),
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TextColumn("left"),
        TimeRemainingColumn(),
        console=Console(stderr=True),
        transient=True,
        redirect_stdout=sys.stdout.isatty(),  # otherwise output for a file would go to the terminal
    ) as progress:
        task = progress.add_task(what, total=None)
        yield lambda done, total: progress.update(task, completed=done, total=total)


def announce_duration(what: str, seconds: float) -> None:
    """Print how long a measurement takes and when it ends; a moving bar would disturb it."""
    if sys.stderr.isatty():
        end = datetime.now() + timedelta(seconds=seconds)
        print(f"{what}: {seconds:.0f} s, until {end:%H:%M:%S}", file=sys.stderr, flush=True)
