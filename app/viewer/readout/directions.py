"""Distances in the six anatomical directions as values for the page."""

from app.geometry import ANATOMICAL_WORDS, SurfaceMesh
from app.session import AxisDistances
from app.viewer.readout.reason_text import distance_text
from app.viewer.steps.view_state import ViewState

_PAIRS = ("R", "L", "A", "P", "S", "I")


class Directions:
    """Distances of the tip to the stop margin. It keeps the tables of the last surface."""

    def __init__(self) -> None:
        self._distances: AxisDistances | None = None

    def values(self, shown: ViewState | None) -> list[dict[str, str]]:
        """One entry for each direction; empty while the state is UNKNOWN or there is no surface."""
        if shown is None or shown.distance_mm is None or shown.step.tumor_from_tip is None:
            return []
        surface = _surface(shown)
        if surface is None:
            return []
        if self._distances is None or self._distances.surface is not surface:
            self._distances = AxisDistances(surface)
        found = self._distances.at(shown.step.tumor_from_tip.translation_mm)
        return [
            {
                "letter": letter,
                "word": ANATOMICAL_WORDS[letter],
                "mm": distance_text(found[letter]),
                "inside": "inside" if (found[letter] or 0.0) < 0.0 else "",
            }
            for letter in _PAIRS
        ]


def _surface(shown: ViewState) -> SurfaceMesh | None:
    """The surface at the stop margin; the tumour's own for a margin of 0."""
    if shown.content.margins.stop_mm == 0.0:
        return shown.content.tumor
    return shown.margin_surface
