"""Surface markers of a session, serialised in advance because that takes long."""

from rclpy.serialization import serialize_message

from app.bridge.publishing.markers import Markers, margin_text
from app.fixture import FixtureDecision, MarginState
from app.runtime import SessionContent

_MAX_TEXTS = 1024
"""A text has a decimal of a millimetre, so that most steps have one that is known."""


class PreparedShapes:
    """Surface markers of ``content``, serialised once for each margin state.

    Create them in another thread while the session continues.
    """

    def __init__(self, content: SessionContent) -> None:
        self._tumor, self._tool = content.tumor, content.tool
        self._markers = Markers(content)
        self._surfaces = {state: self._markers.surfaces(state) for state in MarginState}
        self._texts: dict[tuple[MarginState, str], bytes] = {}

    def match(self, content: SessionContent) -> bool:
        """True if they were created from the tumour and the tool of ``content``."""
        return content.tumor is self._tumor and content.tool is self._tool

    def surfaces(self, state: MarginState) -> bytes:
        """Serialised ``MarkerArray`` of the tumour, in the colour of ``state``, and of the tool."""
        return self._surfaces[state]

    def text(self, decision: FixtureDecision) -> bytes:
        """Serialised ``MarkerArray`` of the margin's text, above the tumour."""
        key = (decision.state, margin_text(decision))
        known = self._texts.get(key)
        if known is None:
            if len(self._texts) >= _MAX_TEXTS:
                self._texts.clear()
            known = self._texts[key] = bytes(serialize_message(self._markers.text(decision)))
        return known
