"""Pages of text and tables for a PDF, drawn with matplotlib, which the reports need anyway."""

import textwrap
from collections.abc import Sequence
from io import BytesIO
from types import TracebackType
from typing import Any, Self

from matplotlib.backends.backend_pdf import PdfPages
from matplotlib.figure import Figure
from matplotlib.image import imread
from matplotlib.lines import Line2D

from app.report.colors import INK, LINE, SOFT

WIDTH_PT, HEIGHT_PT = 595.0, 842.0
"""A4, upright."""
MARGIN_PT = 46.0

_EM_PER_CHAR = 0.53
"""Width of a character of DejaVu Sans, slightly more than its mean."""
_LEADING = 1.35
_CELL_PT = 8.0


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

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
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
