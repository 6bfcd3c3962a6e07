"""Writes the reports of a replay, with the processes that make their parts."""

import argparse
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from functools import partial
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self

from app.cli.complete_report import MODULES, CompleteReport
from app.cli.report_pdf import pdf_of
from app.cli.stopwatch import Stopwatch

if TYPE_CHECKING:
    from app.cli.bag_writing import BagProcess
    from app.report import ReplayLog, ReplayRecord
    from app.runtime import ReplayRun

_PLOT_MODULES = ("app.report.margin_plot",)
_PDF_MODULES = (*_PLOT_MODULES, "app.report.pdf")


class ReplayReport:
    """The files of ``--report``, ``--pdf`` and ``--all`` of one replay; a context around it.

    The process that draws plots and PDF starts with the context for ``--all`` and ``--pdf``, and
    loads matplotlib meanwhile; for a plot alone after the replay, which it would slow down.
    """

    def __init__(self, options: argparse.Namespace, watch: Stopwatch) -> None:
        from app.report import ReportProcess

        self._options = options
        self._watch = watch
        self._has_pdf = options.all or options.pdf is not None
        modules = _PDF_MODULES if self._has_pdf else _PLOT_MODULES
        self._process = ReportProcess(MODULES if options.all else modules)
        self._contexts = ExitStack()
        self._complete: CompleteReport | None = None

    def __enter__(self) -> Self:
        if self._has_pdf:
            self._contexts.enter_context(self._process)
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self._contexts.close()

    @contextmanager
    def with_all(self, run: "ReplayRun", bag: "BagProcess") -> Iterator[None]:
        """Write the parts of ``--all`` as well, within the context."""
        self._complete = CompleteReport(self._options.report, self._process, bag)
        with self._complete.writing(run):
            yield

    @property
    def incomplete(self) -> bool:
        """True if a part of ``--all`` is missing."""
        return self._complete is not None and self._complete.failed

    def write(
        self,
        run: "ReplayRun",
        log: "ReplayLog",
        record: "ReplayRecord",
        draw: Callable[[], bytes | None],
    ) -> dict[str, Any]:
        """Write all files and return the summary; ``draw`` waits for the picture."""
        from app import __version__
        from app.files import write_file
        from app.report import analysed_replay, summarise, write_report
        from app.report.methods import input_digests

        options, watch, content = self._options, self._watch, run.prepared.content
        picture = _Once(draw)
        if not self._has_pdf:
            self._contexts.enter_context(self._process)
        plot = None if options.report is None else self._process.begin_margin_plot(record)
        summary = summarise(record)
        insertion, pdf = None, None
        if self._has_pdf:
            from app.analysis import case_insertion

            if log.rows:
                insertion = case_insertion(log.samples(), content.tumor)
            digests = input_digests(run.prepared.case)
            pdf = self._process.begin(
                pdf_of, lambda: (record, summary, picture(), digests, insertion)
            )
        watch.lap("summarise")
        if plot is not None:
            analysed = analysed_replay(run, log, __version__, insertion=insertion)
            watch.lap("analyse the steps")
            complete = self._complete
            others: Callable[[], dict[str, bytes | None]] = dict
            if complete is not None and analysed is not None and pdf is not None:
                complete.begin_dicom(content, analysed)
                others = partial(complete.files, pdf)
            summary = write_report(
                options.report,
                record,
                scene_png=lambda: self._waited(picture),
                version=__version__,
                analysed=analysed,
                margin_plot=plot.wait_or_make,
                others=others,
            )
            watch.lap("write the report")
            if complete is not None:
                complete.install()
                watch.lap("write DICOM and bag")
                for name, seconds in complete.processor_s.items():
                    watch.add(f"of processor time of another process: {name}", seconds)
        if options.pdf is not None and pdf is not None:
            write_file(options.pdf, pdf.wait_or_make())
            watch.lap("write the PDF")
        return summary

    def _waited(self, picture: Callable[[], bytes | None]) -> bytes | None:
        """Wait for the picture that another process draws; the time counts by itself."""
        self._watch.lap("write the report")
        drawn = picture()
        self._watch.lap("wait for scene.png")
        return drawn


class _Once:
    """Calls ``make`` once, whichever thread comes first, and returns its result to all."""

    def __init__(self, make: Callable[[], bytes | None]) -> None:
        self._make = make
        self._lock = threading.Lock()
        self._made: list[bytes | None] = []

    def __call__(self) -> bytes | None:
        with self._lock:
            if not self._made:
                self._made.append(self._make())
            return self._made[0]
