"""Rows of text in a Qt table."""

from collections.abc import Sequence
from typing import Any

import qt


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
