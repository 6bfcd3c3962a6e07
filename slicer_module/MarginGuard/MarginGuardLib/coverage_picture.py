"""Draws the poses of a calibration and the directions that they cover."""

from typing import Any

import qt

from app.workflow import Coverage

SIZE = 150
_RANGE_DEG = 50.0
_COVERED, _OPEN, _LINE, _POSE = "#4c9f70", "#d8dee3", "#5b6a75", "#10202c"
_FULL_TURN = 16 * 360
"""Qt counts angles in sixteenths of a degree, counterclockwise from +x."""


def coverage_picture(coverage: Coverage) -> Any:
    """A `QPixmap`: covered sectors are dark green, circles at 15 and 30 degrees, poses are dots."""
    pixmap = qt.QPixmap(SIZE, SIZE)
    pixmap.fill(qt.QColor("#ffffff"))
    painter = qt.QPainter(pixmap)
    painter.setPen(qt.QPen(qt.QColor(_LINE)))
    count = len(coverage.sectors)
    for number, is_covered in enumerate(coverage.sectors):
        painter.setBrush(qt.QBrush(qt.QColor(_COVERED if is_covered else _OPEN)))
        begin = number * _FULL_TURN // count
        painter.drawPie(1, 1, SIZE - 2, SIZE - 2, begin, _FULL_TURN // count)
    for radius_deg in (15.0, 30.0):
        radius = round(radius_deg / _RANGE_DEG * SIZE / 2)
        for turn in range(0, _FULL_TURN, _FULL_TURN // 4):
            corner = SIZE // 2 - radius
            painter.drawArc(corner, corner, 2 * radius, 2 * radius, turn, _FULL_TURN // 4)
    painter.setBrush(qt.QBrush(qt.QColor(_POSE)))
    for x_deg, y_deg in coverage.points_deg.clip(-_RANGE_DEG, _RANGE_DEG).tolist():
        x, y = (round((1.0 + s / _RANGE_DEG) * SIZE / 2) for s in (x_deg, -y_deg))
        painter.drawEllipse(x - 1, y - 1, 2, 2)
    painter.end()
    return pixmap
