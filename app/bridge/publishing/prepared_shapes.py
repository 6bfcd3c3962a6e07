"""Surface markers of a session, serialised in advance because that takes long."""

from visualization_msgs.msg import MarkerArray

from app.bridge.publishing.markers import Markers
from app.fixture import FixtureDecision, MarginState
from app.runtime import SessionContent


class PreparedShapes:
    """Surface markers of ``content``, serialised once for each margin state.

    Create them in another thread while the session continues.
    """

    def __init__(self, content: SessionContent) -> None:
        self._tumor, self._tool = content.tumor, content.tool
        self._markers = Markers(content)
        self._surfaces = {state: self._markers.surfaces(state) for state in MarginState}

    def match(self, content: SessionContent) -> bool:
        """True if they were created from the tumour and the tool of ``content``."""
        return content.tumor is self._tumor and content.tool is self._tool

    def surfaces(self, state: MarginState) -> bytes:
        """Serialised ``MarkerArray`` of the tumour, in the colour of ``state``, and of the tool."""
        return self._surfaces[state]

    def text(self, decision: FixtureDecision) -> MarkerArray:
        """Text marker of the margin, above the tumour; each call fills in the same marker."""
        return self._markers.text(decision)
