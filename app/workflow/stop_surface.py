"""The surface at the stop margin, as the page draws it and the directions measure to it."""

from app.fixture import margin_surface
from app.geometry import SurfaceMesh
from app.runtime.content import SessionContent

_SPACING_MM = 1.0
"""Coarse, because the translucent surface is drawn many times a second."""


def stop_surface(content: SessionContent) -> SurfaceMesh | None:
    """The surface ``stop_mm`` outside the tumour; None for a margin of 0. Takes about a second."""
    stop_mm = content.margins.stop_mm
    return margin_surface(content.tumor, stop_mm, spacing_mm=_SPACING_MM) if stop_mm > 0.0 else None
