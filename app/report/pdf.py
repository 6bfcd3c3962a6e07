"""``report.pdf``: the report of a replay on A4 pages, the distance as vector graphics."""

import textwrap
from collections.abc import Mapping, Sequence
from io import BytesIO
from typing import Any, Self

from matplotlib.backends.backend_pdf import PdfPages
from matplotlib.figure import Figure
from matplotlib.image import imread
from matplotlib.lines import Line2D

from app.analysis import Insertion
from app.analysis.samples import find_breaches
from app.case import ENERGY_DEVICE
from app.report.analysis_html import insertion_rows
from app.report.answer import answer, verdict
from app.report.margin_plot import margin_figure
from app.report.page import INK, LINE, NOT_A_DEVICE, SOFT, length, text_of
from app.report.record import ReplayRecord
from app.report.rows import count_reasons
from app.report.summary import ACTIVATION_AT_ENTRY

WIDTH_PT, HEIGHT_PT = 595.0, 842.0
"""A4, upright."""
MARGIN_PT = 46.0

_EM_PER_CHAR = 0.57
"""Width of a character of DejaVu Sans, more than its mean: a path is wider than a sentence."""
_LEADING = 1.35
_CELL_PT = 8.0
_BREACH_COLUMNS = ("", "from", "to", "lasted", "deepest frame", "deepest on the path", "not below")
_METHODS = (
    "The tool's mesh was checked against the tumour's surface in every frame, and on the straight "
    "path between frames around a breach. The distance is signed, negative inside. The lowest "
    "distance of a breach with jitter is too low; 'marginguard analyse' estimates the depth "
    "without that bias. The values do not contain constant errors of registration, calibration "
    "and contour."
)


class PdfLayout:
    """Fills A4 pages from the top: `heading`, `paragraph`, `table`, `picture`, `figure`.

    Use as ``with PdfLayout(title) as pdf``; `content` returns the file afterwards. Each page has
    ``title`` and its number at the bottom. The same calls give the same bytes.
    """

    def __init__(self, title: str) -> None:
        self._title = title
        self._file = BytesIO()
        metadata: Any = {"Title": title, "CreationDate": None, "Producer": None, "Creator": None}
        self._pages: Any = PdfPages(self._file, metadata=metadata)
        self._page: Figure | None = None
        self._number = 0
        self._y = 0.0

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.end_page()
        self._pages.close()

    @property
    def content(self) -> bytes:
        """The bytes of the file, after the context."""
        return self._file.getvalue()

    def heading(self, text: str, *, size: float = 12.0) -> None:
        """A line in bold that stays on the page of what follows it."""
        self._need(size * _LEADING + 60.0)
        self._y += 0.9 * size
        for line in _wrapped(text, WIDTH_PT - 2 * MARGIN_PT, size * 1.1):
            self._line(MARGIN_PT, line, size, weight="bold")

    def paragraph(self, text: str, *, size: float = 9.0, color: str = INK) -> None:
        """Wrapped text."""
        for line in _wrapped(text, WIDTH_PT - 2 * MARGIN_PT, size):
            self._need(size * _LEADING)
            self._line(MARGIN_PT, line, size, color=color)
        self._y += 0.4 * size

    def table(
        self, header: Sequence[str], rows: Sequence[Sequence[str]], shares: Sequence[float]
    ) -> None:
        """A table with wrapped cells; ``shares`` of the width by column. The header repeats."""
        self._row(header, shares, weight="bold", together=2)
        for row in rows:
            if self._row(row, shares):
                self._row(header, shares, weight="bold")
                self._row(row, shares)
        self._y += _CELL_PT

    def picture(self, png: bytes, caption: str) -> None:
        """A picture over the width of the text, with its caption below."""
        pixels = imread(BytesIO(png))
        width = WIDTH_PT - 2 * MARGIN_PT
        height = min(width * pixels.shape[0] / pixels.shape[1], HEIGHT_PT - 4 * MARGIN_PT)
        self._need(height + 30.0)
        bottom = HEIGHT_PT - self._y - height
        axes = self._current.add_axes(
            (MARGIN_PT / WIDTH_PT, bottom / HEIGHT_PT, width / WIDTH_PT, height / HEIGHT_PT)
        )
        axes.imshow(pixels, interpolation="none")  # as it is, not resampled
        axes.set_axis_off()
        self._y += height + 6.0
        self.paragraph(caption, size=8.0, color=SOFT)

    def figure(self, figure: Figure) -> None:
        """A page of its own for ``figure``, in its own size."""
        self.end_page()
        self._number += 1
        self._pages.savefig(figure)

    def end_page(self) -> None:
        """Continue on a new page."""
        if self._page is not None:
            self._pages.savefig(self._page)
            self._page = None

    @property
    def _current(self) -> Figure:
        if self._page is None:
            self._page = Figure(figsize=(WIDTH_PT / 72.0, HEIGHT_PT / 72.0))
            self._number += 1
            self._y = HEIGHT_PT - 0.6 * MARGIN_PT
            title = textwrap.shorten(self._title, 80)
            self._line(MARGIN_PT, f"{title}, page {self._number}", 7.0, color=SOFT)
            self._y = MARGIN_PT
        return self._page

    def _need(self, height_pt: float) -> bool:
        """Begin a page unless ``height_pt`` is left on this one; True if one was begun."""
        self._current  # noqa: B018  (begins the first page)
        if self._y + height_pt <= HEIGHT_PT - MARGIN_PT:
            return False
        self.end_page()
        self._current  # noqa: B018
        return True

    def _line(self, x_pt: float, text: str, size: float, **style: Any) -> None:
        style.setdefault("color", INK)
        self._current.text(
            x_pt / WIDTH_PT,
            1.0 - self._y / HEIGHT_PT,
            text,
            fontsize=size,
            va="top",
            parse_math=False,
            **style,
        )
        self._y += size * _LEADING

    def _row(
        self, cells: Sequence[str], shares: Sequence[float], *, weight: str = "", together: int = 1
    ) -> bool:
        """Draw a row; True, and nothing drawn, if a page was begun for it."""
        width = WIDTH_PT - 2 * MARGIN_PT
        wrapped = [
            _wrapped(cell, share * width - 6.0, _CELL_PT * (1.1 if weight else 1.0))
            for cell, share in zip(cells, shares, strict=True)
        ]
        height = max(map(len, wrapped)) * _CELL_PT * _LEADING + 4.0
        if self._need(height * together) and not weight:
            return True
        top, x = self._y, MARGIN_PT
        for lines, share in zip(wrapped, shares, strict=True):
            self._y = top + 2.0
            for line in lines:
                self._line(x, line, _CELL_PT, weight=weight or "normal")
            x += share * width
        self._y = top + height
        y = 1.0 - self._y / HEIGHT_PT
        ends = (MARGIN_PT / WIDTH_PT, 1.0 - MARGIN_PT / WIDTH_PT)
        self._current.add_artist(Line2D(ends, (y, y), color=LINE, lw=0.6))
        return False


def _wrapped(text: str, width_pt: float, size: float) -> list[str]:
    chars = max(int(width_pt / (size * _EM_PER_CHAR)), 4)
    return textwrap.wrap(text, chars, break_long_words=True) or [""]


def report_pdf(
    record: ReplayRecord,
    summary: Mapping[str, Any],
    scene_png: bytes | None,
    *,
    version: str,
    inputs_sha256: Mapping[str, str],
    insertion: Insertion | None = None,
) -> bytes:
    """The report as PDF. The same arguments give the same bytes.

    ``summary`` is that of ``record``; its ``timing`` is left out. ``inputs_sha256`` are the
    digests of the files of the case, by name. ``insertion``: its metrics; None leaves them out.
    """
    case = str(summary["case"])
    breaches = find_breaches(record.rows, record.margins.stale_after_ns)
    with PdfLayout(f"{case}: margin report") as pdf:
        pdf.heading(case, size=17.0)
        found = answer(summary)
        pdf.heading(found.headline, size=13.0)
        for line in found.lines:
            pdf.paragraph(line)
        origin = "; ".join(f"{key}: {value}" for key, value in summary["provenance"].items())
        pdf.paragraph(origin, color=SOFT)
        pdf.paragraph(NOT_A_DEVICE)
        pdf.heading("Results")
        pdf.table(("", "value"), _results(summary), (0.5, 0.5))
        pdf.heading("Breaches")
        if summary["breaches"]:
            pdf.table(*_breaches(summary["breaches"]))
        else:
            pdf.paragraph("The tool was never in the tumour.")
        if insertion is not None:
            pdf.heading("Insertion")
            rows = insertion_rows(insertion)
            pdf.table(("metric of Perk Tutor", "value"), rows, (0.5, 0.5))
        pdf.heading("Margin states")
        seconds, counts = summary["state_seconds"], summary["state_counts"]
        states = [(name, str(counts[name]), f"{seconds[name]:.3f} s") for name in counts]
        pdf.table(("state", "frames", "time"), states, (0.4, 0.3, 0.3))
        pdf.figure(margin_figure(record.rows, breaches, record.margins, case))
        if scene_png is not None:
            pdf.heading("Deepest point")
            pdf.picture(scene_png, "Tumour, tool and robot at the smallest distance.")
        pdf.heading("Reasons")
        reasons = [
            (each.reason, str(each.frames), f"{each.first_s:.3f} s")
            for each in count_reasons(record.rows)
        ]
        pdf.table(("reason", "frames", "first at"), reasons, (0.4, 0.3, 0.3))
        pdf.heading("Margins")
        pdf.table(("parameter", "value"), _pairs(summary["margins"]), (0.5, 0.5))
        if summary["registration"] is not None:
            pdf.heading("Registration")
            pdf.table(("", "value"), _registration(summary["registration"]), (0.3, 0.7))
        if summary["notes"]:
            pdf.heading("Notes of the reader")
            for note in summary["notes"]:
                pdf.paragraph(note)
        pdf.heading("Methods")
        pdf.paragraph(_METHODS)
        digests = [("MarginGuard", version), *inputs_sha256.items()]
        pdf.table(("input", "version or SHA-256"), digests, (0.3, 0.7))
        if summary["expected"] is not None:
            pdf.heading(f"Checks against the truth: {verdict(summary['expected'])}")
            checks = [
                (each["check"], each["result"], each["detail"]) for each in summary["expected"]
            ]
            pdf.table(("check", "result", "found"), checks, (0.32, 0.08, 0.6))
    return pdf.content


def _results(summary: Mapping[str, Any]) -> Sequence[tuple[str, str]]:
    frames, valid = summary["frames"], summary["valid_frames"]
    return (
        ("smallest signed distance in a frame", length(summary["min_signed_distance_mm"])),
        ("smallest on the path", length(summary["path_min_signed_distance_mm"])),
        ("replayed", f"{summary['duration_s']:.3f} s, {frames} frames"),
        ("frames with a valid distance", f"{valid} ({100.0 * valid / frames:.1f} %)"),
        ("measured", "tip alone" if summary["tip_only"] else "whole mesh of the tool"),
    )


def _breaches(
    breaches: Sequence[Mapping[str, Any]],
) -> tuple[tuple[str, ...], Sequence[tuple[str, ...]], tuple[float, ...]]:
    """Header, rows and widths; the activation only of a case with a source of it."""
    rows = [
        (
            str(number),
            *(f"{breach[key]:.3f} s" for key in ("start_s", "end_s", "duration_s")),
            length(breach["min_signed_distance_mm"]),
            length(breach["path_min_signed_distance_mm"]),
            length(breach["path_lower_bound_mm"]),
            *((str(breach[ACTIVATION_AT_ENTRY]),) if ACTIVATION_AT_ENTRY in breach else ()),
        )
        for number, breach in enumerate(breaches, start=1)
    ]
    if ACTIVATION_AT_ENTRY not in breaches[0]:
        return _BREACH_COLUMNS, rows, (0.06, *(0.14,) * 4, 0.2, 0.18)
    return (*_BREACH_COLUMNS, ENERGY_DEVICE.name), rows, (0.05, *(0.12,) * 4, 0.17, 0.16, 0.14)


def _registration(registration: Mapping[str, Any]) -> Sequence[tuple[str, str]]:
    names = ("method", "accepted", "reason", "target", "source", "points", "fre_mm", "fle_mm")
    return _pairs({name: registration[name] for name in names})


def _pairs(values: Mapping[str, Any]) -> Sequence[tuple[str, str]]:
    return [(name, text_of(None if value == "" else value)) for name, value in values.items()]
