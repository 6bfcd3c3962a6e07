"""The widget in which a user chooses the tool that is calibrated or that touches points."""

from typing import Any

from app.runtime import TrackedTool


class ToolChoice:
    """Fills ``combo_box`` with the tools. Without a stylus the choice is the tool of the guard."""

    def __init__(self, combo_box: Any) -> None:
        self._combo_box = combo_box
        combo_box.addItems([each.value for each in TrackedTool])

    @property
    def tool(self) -> TrackedTool:
        """The chosen tool."""
        return TrackedTool(self._combo_box.property("currentText"))

    def show(self, stylus: str) -> None:
        """Let the user choose in a session with a stylus; ``stylus`` is empty without one."""
        self._combo_box.setEnabled(bool(stylus))
        if not stylus:
            self._combo_box.setCurrentIndex(0)
