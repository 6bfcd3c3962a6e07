"""The needle as a value of the page."""

from app.viewer.steps.view_state import ViewState


def needle_values(shown: ViewState | None) -> dict[str, str] | None:
    """Length of the needle as text in mm; None without a needle."""
    needle = None if shown is None else shown.content.needle
    return None if needle is None else {"length": f"{needle.length_mm:g}"}
