"""The widgets of the needle."""

from collections.abc import Callable
from functools import partial
from typing import Any


class NeedleSection:
    """Connects the buttons, and shows the length.

    ``on_click(button, command)`` has ``command(panel_logic)`` called at each click.
    """

    def __init__(self, ui: Any, on_click: Callable[[Any, Callable[[Any], object]], None]) -> None:
        self._label = ui.needleLengthLabel
        self._buttons = {
            -5.0: ui.needleMuchShorterButton,
            -1.0: ui.needleShorterButton,
            1.0: ui.needleLongerButton,
            5.0: ui.needleMuchLongerButton,
        }
        for by_mm, button in self._buttons.items():
            on_click(button, partial(_lengthen, by_mm))

    def show(self, length: str, *, is_live: bool) -> None:
        """Show ``length`` in mm, empty without a needle."""
        self._label.setText(length or "no needle")
        for button in self._buttons.values():
            button.setEnabled(is_live and bool(length))


def _lengthen(by_mm: float, logic: Any) -> None:
    logic.needle.lengthen(by_mm)
