"""Markers for RViz and Foxglove: surfaces as triangles, so that no mesh file is needed.

Two publishers share ``~/markers``, because a latched topic keeps the last message of *each*
publisher: one for the surfaces, at every change of the margin state (their colour), and one for the
text, at every step. Late subscribers get both. All markers have stamp 0 and are locked to their
frame, so that a viewer draws them at the latest pose.
"""

from builtin_interfaces.msg import Time
from geometry_msgs.msg import Pose, Quaternion
from std_msgs.msg import ColorRGBA, Header
from visualization_msgs.msg import Marker, MarkerArray

from app.bridge.messages import color_message, metres, point_message
from app.bridge.publishing.marker_points import corners_m, placeholder, serialized
from app.fixture import FixtureDecision, MarginState
from app.runtime import SessionContent

TUMOR_ALPHA = 0.4
TOOL_RGB = (1.0, 1.0, 0.0)
TEXT_HEIGHT_MM = 6.0
TEXT_ABOVE_TUMOR_MM = 10.0


class Markers:
    """Creates the markers of a session. The triangles are converted once for all colours.

    A surface of more than `MAX_TRIANGLES` triangles is simplified for its marker.
    """

    def __init__(self, content: SessionContent) -> None:
        self._tumor_frame = content.tumor.frame
        self._points_m = [corners_m(content.tumor)]
        self._tool_frame = None if content.tool is None else content.tool.frame
        if content.tool is not None:
            self._points_m.append(corners_m(content.tool))
        lowest, highest = content.tumor.bounds_mm
        text_at_mm = (lowest + highest) / 2.0
        text_at_mm[2] = highest[2] + TEXT_ABOVE_TUMOR_MM
        self._text = _marker("margin", self._tumor_frame, Marker.TEXT_VIEW_FACING, ColorRGBA())
        self._text.pose.position = point_message(text_at_mm)
        self._text.scale.z = float(metres(TEXT_HEIGHT_MM))

    def surfaces(self, state: MarginState) -> bytes:
        """Serialised `MarkerArray` of the tumour, in the colour of ``state``, and of the tool.

        Both are a TRIANGLE_LIST.
        """
        color = color_message(state.color, TUMOR_ALPHA)
        markers = [_surface("tumor", self._tumor_frame, color, 0)]
        if self._tool_frame is not None:
            markers.append(_surface("tool", self._tool_frame, color_message(TOOL_RGB), 1))
        return serialized(MarkerArray(markers=markers), self._points_m)

    def text(self, decision: FixtureDecision) -> MarkerArray:
        """Marker with the text of the margin, above the tumour, in the colour of the state.

        Each call fills in the same marker: publish it before the next one.
        """
        self._text.color = color_message(decision.state.color)
        self._text.text = margin_text(decision)
        return MarkerArray(markers=[self._text])


def margin_text(decision: FixtureDecision) -> str:
    """Text such as ``CLEAR +9.2 mm``, ``IN TUMOUR -1.4 mm``, or ``UNKNOWN: stale, missing``."""
    if decision.state is MarginState.UNKNOWN or decision.proximity is None:
        reasons = ", ".join(str(reason) for reason in decision.reasons)
        return f"{MarginState.UNKNOWN.display.label}: {reasons}"
    return f"{decision.state.display.label} {decision.proximity.signed_distance_mm:+.1f} mm"


def _surface(name: str, frame: str, color: ColorRGBA, number: int) -> Marker:
    marker = _marker(name, frame, Marker.TRIANGLE_LIST, color)
    marker.points = [placeholder(number)]
    return marker


def _marker(name: str, frame: str, kind: int, color: ColorRGBA) -> Marker:
    marker = Marker(
        header=Header(frame_id=frame, stamp=Time()),
        ns=name,
        type=kind,
        action=Marker.ADD,
        pose=Pose(orientation=Quaternion(w=1.0)),
        color=color,
        frame_locked=True,
    )
    marker.scale.x = marker.scale.y = marker.scale.z = 1.0
    return marker
