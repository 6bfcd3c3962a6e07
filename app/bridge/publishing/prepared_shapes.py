"""The surfaces of a session, serialised ahead of time because that takes long."""

from rclpy.serialization import serialize_message
from visualization_msgs.msg import MarkerArray

from app.bridge.publishing.markers import Markers
from app.fixture import FixtureDecision, MarginState
from app.runtime import SessionContent


class PreparedShapes:
    """Tumour and tool of ``content``, serialised once a state.

    A tumour of 80k triangles takes some 0.7 s. They are therefore made in another thread while the
    session goes on.
    """

    def __init__(self, content: SessionContent) -> None:
        self._tumor, self._tool = content.tumor, content.tool
        self._markers = Markers(content)
        self._surfaces = {
            state: serialize_message(self._markers.surfaces(state)) for state in MarginState
        }

    def match(self, content: SessionContent) -> bool:
        """True if they were made of the tumour and the tool of ``content``."""
        return content.tumor is self._tumor and content.tool is self._tool

    def surfaces(self, state: MarginState) -> bytes:
        """A serialised ``MarkerArray``: the tumour in the colour of ``state``, and the tool."""
        return self._surfaces[state]

    def words(self, decision: FixtureDecision) -> MarkerArray:
        """The text marker of the margin, above the tumour."""
        return self._markers.words(decision)
