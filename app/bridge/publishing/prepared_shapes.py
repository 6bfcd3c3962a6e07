"""The surfaces of a scene, ready to be sent: made where it may take long."""

from rclpy.serialization import serialize_message
from visualization_msgs.msg import MarkerArray

from app.bridge.publishing.markers import Markers
from app.bridge.publishing.replay_scene import ReplayScene
from app.fixture import FixtureDecision, MarginState


class PreparedShapes:
    """Tumour and tool of ``scene``, serialised once a state.

    A tumour of 80k triangles takes some 0.7 s: a session that runs goes on meanwhile, while these
    are made in another thread.
    """

    def __init__(self, scene: ReplayScene) -> None:
        self._tumor, self._tool = scene.tumor, scene.tool
        self._markers = Markers(scene)
        self._surfaces = {
            state: serialize_message(self._markers.surfaces(state)) for state in MarginState
        }

    def are_of(self, scene: ReplayScene) -> bool:
        """Whether ``scene`` has the very tumour and tool that these were made of."""
        return scene.tumor is self._tumor and scene.tool is self._tool

    def surfaces(self, state: MarginState) -> bytes:
        """A serialised ``MarkerArray``: the tumour in the colour of ``state``, and the tool."""
        return self._surfaces[state]

    def words(self, decision: FixtureDecision) -> MarkerArray:
        """The margin in words, above the tumour."""
        return self._markers.words(decision)
