"""Distances of the tool's tip to the stop margin, and the surface there."""

from collections.abc import Mapping

from app.fixture import MarginState, margin_surface
from app.geometry import SurfaceMesh
from app.runtime.content import SessionContent
from app.session import AxisDistances, StepResult


class TipDirections:
    """Measures along the axes of the tumour's frame. It keeps the tables of the last surface."""

    def __init__(self) -> None:
        self._distances: AxisDistances | None = None

    def at(
        self, step: StepResult, content: SessionContent, stop_surface: SurfaceMesh | None
    ) -> Mapping[str, float | None]:
        """Distances in mm by letter, as `AxisDistances.at`; empty while they are not known.

        ``stop_surface``: the surface at the stop margin; None while it is not computed. The
        tumour's own is used for a margin of 0.
        """
        decision = step.decision
        surface = content.tumor if content.margins.stop_mm == 0.0 else stop_surface
        is_known = decision.proximity is not None and decision.proximity.is_finite
        is_known = is_known and decision.state is not MarginState.UNKNOWN
        if surface is None or step.tumor_from_tip is None or not is_known:
            return {}
        if self._distances is None or self._distances.surface is not surface:
            self._distances = AxisDistances(surface)
        return self._distances.at(step.tumor_from_tip.translation_mm)


_SPACING_MM = 1.0
"""Coarse, because the translucent surface is drawn many times a second."""


def stop_surface(content: SessionContent) -> SurfaceMesh | None:
    """The surface ``stop_mm`` outside the tumour; None for a margin of 0. Takes about a second."""
    stop_mm = content.margins.stop_mm
    return margin_surface(content.tumor, stop_mm, spacing_mm=_SPACING_MM) if stop_mm > 0.0 else None
