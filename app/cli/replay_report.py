"""Reports of a replay: files, with the processes that make their parts, and a text."""

import argparse
import sys
import threading
import time
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager, ExitStack
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from app import __version__
from app.cli.complete_report import MODULES, CompleteReport
from app.files import write_file

if TYPE_CHECKING:
    from app.analysis import Insertion
    from app.cli.bag_writing import BagProcess
    from app.report import ReplayLog, ReplayRecord
    from app.runtime import ReplayRun


_PLOT_MODULES = ("app.report.margin_plot",)
_PDF_MODULES = (*_PLOT_MODULES, "app.report.pdf")


class Stopwatch:
    """Consecutive laps, starting at construction."""

    def __init__(self) -> None:
        self._laps: dict[str, float] = {}
        self._last_s = time.perf_counter()

    def lap(self, name: str) -> None:
        """Add the time since the last lap to ``name``."""
        now_s = time.perf_counter()
        self._laps[name] = self._laps.get(name, 0.0) + now_s - self._last_s
        self._last_s = now_s

    def add(self, name: str, seconds: float) -> None:
        """Add a time that was measured elsewhere."""
        self._laps[name] = self._laps.get(name, 0.0) + seconds

    def print_laps(self) -> None:
        """Print seconds and name of each lap to standard error."""
        for name, seconds in self._laps.items():
            print(f"{seconds:9.3f} s  {name}", file=sys.stderr)


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

    def __exit__(self, *_: object) -> None:
        self._contexts.close()

    def with_all(self, run: "ReplayRun", bag: "BagProcess") -> AbstractContextManager[object]:
        """Write the parts of ``--all`` as well, within the context."""
        self._complete = CompleteReport(self._options.report, self._process, bag)
        return self._complete.writing(run)

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


def pdf_of(
    record: "ReplayRecord",
    summary: dict[str, Any],
    scene: bytes | None,
    digests: Mapping[str, str],
    insertion: "Insertion | None",
) -> bytes:
    """The report as PDF.

    ``scene`` is a PNG, ``digests`` are those of the case's files by `input_digests`. ``insertion``
    as of `case_insertion`, None for a replay without frames.
    """
    from app.report.pdf import report_pdf

    return report_pdf(
        record, summary, scene, version=__version__, inputs_sha256=digests, insertion=insertion
    )


def summary_text(summary: dict[str, Any], report: Path | None) -> str:
    """Format ``summary`` (as in ``summary.json``) in a few lines."""
    from app.session import SINGLE_SOURCE

    lines = [
        summary["case"],
        f"  frames        {summary['frames']} ({summary['valid_frames']} valid) "
        f"in {summary['duration_s']:.3f} s",
        "  states        "
        + ", ".join(
            f"{name} {seconds:.2f} s" for name, seconds in summary["state_seconds"].items()
        ),
    ]
    lines.append(f"  nearest       {_closest(summary)}")
    for number, breach in enumerate(summary["breaches"], start=1):
        lines.append(
            f"  breach {number:<6} {breach['start_s']:.3f} to {breach['end_s']:.3f} s, "
            f"deepest {breach['min_signed_distance_mm']:.3f} mm{_on_path(breach)}"
        )
    if not summary["breaches"]:
        lines.append("  breaches      none")
    lines += [
        f"  {each['name']:<13} {_closest(each)}, breaches: {len(each['breaches'])}"
        for each in summary.get("structures", ())
    ]
    if summary["single_source"]:
        lines.append(f"  checked by    {SINGLE_SOURCE}")
    if summary["registration"] is not None:
        lines.append(f"  registration  {summary['registration']['reason']}")
    lines += [
        f"  {check['result']:<13} {check['check']}: {check['detail']}"
        for check in summary["expected"] or ()
    ]
    lines += [f"  note          {note}" for note in summary["notes"]]
    if report is not None:
        lines.append(f"  report        {report / 'report.html'}")
    return "\n".join(lines)


def _closest(summary: dict[str, Any]) -> str:
    nearest = summary["min_signed_distance_mm"]
    return "not known" if nearest is None else f"{nearest:.3f} mm"


def _on_path(breach: dict[str, Any]) -> str:
    """Where the tool is deepest between frames; empty if it is not known."""
    if breach["deepest_s"] is None:
        return ""
    seen = "; seen in no frame" if breach["between_frames"] else ""
    return (
        f"; on the path {breach['path_min_signed_distance_mm']:.3f} mm at "
        f"{breach['deepest_s']:.3f} s, not below {breach['path_lower_bound_mm']:.3f} mm{seen}"
    )
