"""The stylus as a value of the page."""

from typing import Any

from app.runtime import TrackedTool, stylus_text
from app.viewer.steps.view_state import ViewState


def stylus_values(shown: ViewState | None) -> dict[str, Any] | None:
    """Its tip as text, and the tools that a page lets its user choose from; None without one."""
    text = None if shown is None else stylus_text(shown.content)
    return None if not text else {"text": text, "tools": [each.value for each in TrackedTool]}
