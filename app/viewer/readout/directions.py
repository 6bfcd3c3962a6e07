"""Distances in the six anatomical directions as values for the page."""

from app.geometry import ANATOMICAL_WORDS
from app.viewer.readout.reason_text import distance_text
from app.viewer.steps.view_state import ViewState
from app.workflow import TipDirections

_PAIRS = ("R", "L", "A", "P", "S", "I")


class Directions:
    """Distances of the tip to the stop margin."""

    def __init__(self) -> None:
        self._directions = TipDirections()

    def values(self, shown: ViewState | None) -> list[dict[str, str]]:
        """One entry for each direction; empty while the state is UNKNOWN or there is no surface."""
        if shown is None:
            return []
        found = self._directions.at(shown.step, shown.content, shown.margin_surface)
        return [
            {
                "letter": letter,
                "word": ANATOMICAL_WORDS[letter],
                "mm": distance_text(found[letter]),
                "inside": "inside" if (found[letter] or 0.0) < 0.0 else "",
            }
            for letter in _PAIRS
            if found
        ]
