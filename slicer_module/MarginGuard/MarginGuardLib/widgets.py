"""Widgets that the panel's parts share."""

from collections.abc import Callable, Sequence
from typing import Any

import qt

from app.runtime import tool_names
from app.workflow import RANGE_MM, RINGS_MM, Coverage, NeedleShown

_SIZE = 150
_RANGE_DEG = 50.0
_COVERED, _OPEN, _LINE, _POSE = "#4c9f70", "#d8dee3", "#5b6a75", "#10202c"
_FULL_TURN = 16 * 360
"""Qt counts angles in sixteenths of a degree, counterclockwise from +x."""

OnClick = Callable[[Any, Callable[[Any], object]], None]
"""``on_click(button, command)``: ``command(panel_logic)`` is called at each click."""


def fill_table(table: Any, rows: Sequence[Sequence[str]]) -> None:
    """Show ``rows``; cells that have not changed are kept, and so is the selection."""
    has_changed = False
    table.setRowCount(len(rows))
    for row, texts in enumerate(rows):
        for column, text in enumerate(texts):
            item = table.item(row, column)
            if item is None:
                table.setItem(row, column, qt.QTableWidgetItem(text))
                has_changed = True
            elif item.text() != text:
                item.setText(text)
                has_changed = True
    if has_changed:
        table.resizeColumnsToContents()


class ToolChoice:
    """Fills ``combo_box`` with the tools. In a session with one tool the choice is that one."""

    def __init__(self, combo_box: Any) -> None:
        self._combo_box = combo_box
        combo_box.addItems(list(tool_names()))

    @property
    def tool(self) -> str:
        """The chosen tool."""
        return str(self._combo_box.property("currentText"))

    def show(self, tools: Sequence[str]) -> None:
        """Let the user choose in a session with several ``tools``."""
        self._combo_box.setEnabled(len(tools) > 1)
        if len(tools) < 2:
            self._combo_box.setCurrentIndex(0)


def show_picture(label: Any, picture: Any) -> None:
    """Show a `QPixmap`, None for none, which a narrow panel does not cut off."""
    if picture is None:
        label.clear()
        label.setMinimumHeight(0)
    else:
        label.setPixmap(picture)
        label.setMinimumHeight(picture.height())


def coverage_picture(coverage: Coverage) -> Any:
    """A `QPixmap`: covered sectors are dark green, circles at 15 and 30 degrees, poses are dots."""
    pixmap = qt.QPixmap(_SIZE, _SIZE)
    pixmap.fill(qt.QColor("#ffffff"))
    painter = qt.QPainter(pixmap)
    painter.setPen(qt.QPen(qt.QColor(_LINE)))
    count = len(coverage.sectors)
    for number, is_covered in enumerate(coverage.sectors):
        painter.setBrush(qt.QBrush(qt.QColor(_COVERED if is_covered else _OPEN)))
        begin = number * _FULL_TURN // count
        painter.drawPie(1, 1, _SIZE - 2, _SIZE - 2, begin, _FULL_TURN // count)
    for radius_deg in (15.0, 30.0):
        radius = round(radius_deg / _RANGE_DEG * _SIZE / 2)
        for turn in range(0, _FULL_TURN, _FULL_TURN // 4):
            corner = _SIZE // 2 - radius
            painter.drawArc(corner, corner, 2 * radius, 2 * radius, turn, _FULL_TURN // 4)
    painter.setBrush(qt.QBrush(qt.QColor(_POSE)))
    for x_deg, y_deg in coverage.points_deg.clip(-_RANGE_DEG, _RANGE_DEG).tolist():
        x, y = (round((1.0 + s / _RANGE_DEG) * _SIZE / 2) for s in (x_deg, -y_deg))
        painter.drawEllipse(x - 1, y - 1, 2, 2)
    painter.end()
    return pixmap


def crosshair_picture(shown: NeedleShown) -> Any:
    """A `QPixmap` along the corridor: the tip is a dot, the axis at the skin a circle."""
    pixmap = qt.QPixmap(_SIZE, _SIZE)
    pixmap.fill(qt.QColor("#ffffff"))
    painter = qt.QPainter(pixmap)
    middle, scale = _SIZE // 2, _SIZE / (2.6 * RANGE_MM)  # px per mm
    painter.setPen(qt.QPen(qt.QColor(_LINE)))
    for radius in (round(each * scale) for each in RINGS_MM):
        painter.drawEllipse(middle - radius, middle - radius, 2 * radius, 2 * radius)
    end = round(RANGE_MM * scale)
    painter.drawLine(middle - end, middle, middle + end, middle)
    painter.drawLine(middle, middle - end, middle, middle + end)
    painter.setPen(qt.QPen(qt.QColor(_POSE)))
    letter_px = 8
    corners = (
        (_SIZE - 3 * letter_px, middle - 3),
        (middle + 3, _SIZE - 3),
        (2, middle - 3),
        (middle + 3, letter_px + 2),
    )
    for word, (x, y) in zip(shown.letters, corners, strict=False):
        painter.drawText(x, y, word)
    for place, radius in ((shown.axis, 5), (shown.tip, 3)):
        if place is not None:
            x, y = (middle + round(each * scale) for each in place)
            painter.setBrush(qt.QBrush(qt.QColor(_POSE if place is shown.tip else "#ffffff")))
            painter.drawEllipse(x - radius, y - radius, 2 * radius, 2 * radius)
    painter.end()
    return pixmap
