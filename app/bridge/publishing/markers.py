"""Markers for RViz and Foxglove: surfaces as triangles, so that no mesh file is needed.

Two publishers share ``~/markers``, because a latched topic keeps the last message of *each*
publisher: one for the surfaces, at every change of the margin state (their colour), and one for the
text, at every step. Late subscribers get both. All markers have stamp 0 and are locked to their
frame, so that a viewer draws them at the latest pose.
"""

import struct
from collections.abc import Callable, Sequence
from functools import partial

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Point, Pose, Quaternion
from numpy.typing import NDArray
from rclpy.serialization import serialize_message
from std_msgs.msg import ColorRGBA, Header
from visualization_msgs.msg import Marker, MarkerArray

from app.bridge.messages import color_message, metres, point_message
from app.bridge.ros_errors import BridgeError
from app.fixture import FixtureDecision, MarginState
from app.geometry import FloatArray, SurfaceMesh
from app.runtime import SessionContent
from app.session import named

MAX_TRIANGLES = 25_000
"""A marker with more is simplified: it is sent at each change of colour, 72 bytes a triangle."""

_COARSER = 1.15

_MAX_CELLS = 2000
"""Along the longest side, also where the area is nearly 0, so that the steps to it are few."""

TUMOR_ALPHA = 0.4
TOOL_RGB = (1.0, 1.0, 0.0)
TEXT_HEIGHT_MM = 6.0
TEXT_ABOVE_TUMOR_MM = 10.0

_MAX_TEXTS = 1024
"""A text has a decimal of a millimetre, so that most steps have one that is known."""


def placeholder(number: int) -> Point:
    """The only point of marker ``number`` of an array, for `serialized`."""
    return Point(x=-1.5e300, y=2.5e299, z=1e298 * (number + 1))


def serialized(markers: MarkerArray, points_m: Sequence[FloatArray]) -> bytes:
    """``markers`` with ``points_m`` (k, 3) in place of the `placeholder` of each, serialised.

    In CDR the points follow their number without padding, because three doubles, four floats, two
    integers and one byte come before.
    """
    rest, done = bytes(serialize_message(markers)), b""
    for number, points in enumerate(points_m):
        point = placeholder(number)
        before, mark, rest = rest.partition(struct.pack("<3d", point.x, point.y, point.z))
        if not mark or before[-4:] != struct.pack("<I", 1):
            raise BridgeError(
                f"marker {number}: its points are not where they were expected in the message; "
                "expected the definition of visualization_msgs of ROS 2 Jazzy"
            )
        coordinates = np.ascontiguousarray(points, dtype="<f8")
        done += before[:-4] + struct.pack("<I", len(coordinates)) + coordinates.tobytes()
    return done + rest


def corners_m(mesh: SurfaceMesh, max_faces: int = MAX_TRIANGLES) -> FloatArray:
    """Corners (3 m, 3) of the faces in sequence, in m, of at most ``max_faces`` faces."""
    vertices: FloatArray = mesh.vertices_mm
    faces: NDArray[np.integer] = mesh.faces
    if len(faces) > max_faces:
        vertices, faces = simplified(vertices, faces, max_faces)
    return np.asarray(metres(vertices[faces.reshape(-1)]))


def simplified(
    vertices: FloatArray, faces: NDArray[np.integer], max_faces: int
) -> tuple[FloatArray, NDArray[np.integer]]:
    """A coarser surface with at most ``max_faces`` faces, for display only.

    Vertices in one cell of a grid are replaced by their mean, and faces that degenerate are
    dropped (Rossignac and Borrel 1993): no vertex moves by more than the diagonal of a cell.
    """
    # `take` and `compress` release the GIL, indexing by an array does not.
    a, b, c = (np.take(vertices, faces[:, k], axis=0) for k in range(3))
    area = 0.5 * float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum())
    low = vertices.min(axis=0)
    side = float((vertices.max(axis=0) - low).max())
    cell = max(np.sqrt(2.0 * area / max_faces), side / _MAX_CELLS, 1e-9)
    while True:
        cells = ((vertices - low) / cell).astype(np.int64)
        size = cells.max(axis=0) + 1
        key = (cells[:, 0] * size[1] + cells[:, 1]) * size[2] + cells[:, 2]
        _, index, count = np.unique(key, return_inverse=True, return_counts=True)
        merged = np.take(index, faces)
        first, second, third = merged.T
        distinct = (first != second) & (second != third) & (third != first)
        kept = np.compress(distinct, merged, axis=0)
        if len(kept) <= max_faces:
            sums = [np.bincount(index, weights=vertices[:, axis]) for axis in range(3)]
            return np.stack(sums, axis=1) / count[:, None], kept
        cell *= _COARSER


def margin_text(decision: FixtureDecision, governing: str = "") -> str:
    """Text such as ``CLEAR +9.2 mm``, ``IN TUMOUR -1.4 mm``, or ``UNKNOWN: stale, missing``.

    ``governing`` is the structure that the distance belongs to, in words; empty for the tumour.
    """
    if decision.state is MarginState.UNKNOWN or decision.proximity is None:
        reasons = ", ".join(str(reason) for reason in decision.reasons)
        return f"{MarginState.UNKNOWN.display.label}: {reasons}"
    label = named(decision.state.display.label, governing)
    return f"{label} {decision.proximity.signed_distance_mm:+.1f} mm"


def surface_marker(name: str, frame: str, color: ColorRGBA, number: int) -> Marker:
    """A TRIANGLE_LIST in ``frame`` for `serialized`, as the ``number``-th of its array."""
    marker = marker_message(name, frame, Marker.TRIANGLE_LIST, color)
    marker.points = [placeholder(number)]
    return marker


def marker_message(name: str, frame: str, kind: int, color: ColorRGBA) -> Marker:
    """Marker of scale 1 at the origin of ``frame``, locked to it."""
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


def removed_structure(name: str) -> MarkerArray:
    """Removes the marker of a further structure that is not guarded any more."""
    message = _structure(name, ColorRGBA())
    message.markers[0].action, message.markers[0].points = Marker.DELETE, []
    return message


def _structure(name: str, color: ColorRGBA) -> MarkerArray:
    """Marker of the further structure ``name``, in its own frame."""
    return MarkerArray(markers=[surface_marker(f"structure/{name}", name, color, 0)])


class PreparedShapes:
    """Markers of ``content``: surfaces serialised once for each margin state, and the text.

    The triangles are converted once for all colours. A surface of more than `MAX_TRIANGLES`
    triangles is simplified for its marker. Create them in another thread while the session
    continues.
    """

    def __init__(self, content: SessionContent) -> None:
        self._made_of = _surfaces(content)
        lowest, highest = content.tumor.bounds_mm
        text_at_mm = (lowest + highest) / 2.0
        text_at_mm[2] = highest[2] + TEXT_ABOVE_TUMOR_MM
        self._text = marker_message(
            "margin", content.tumor.frame, Marker.TEXT_VIEW_FACING, ColorRGBA()
        )
        self._text.pose.position = point_message(text_at_mm)
        self._text.scale.z = float(metres(TEXT_HEIGHT_MM))
        self._texts: dict[tuple[MarginState, str, tuple[str, ...]], bytes] = {}

        tool = [] if content.tool is None else [content.tool]
        tools = [surface_marker("tool", each.frame, color_message(TOOL_RGB), 1) for each in tool]
        self._surfaces = _of_states(
            lambda color: MarkerArray(
                markers=[surface_marker("tumor", content.tumor.frame, color, 0), *tools]
            ),
            [corners_m(each) for each in (content.tumor, *tool)],
        )
        self._structures = {
            each.name: _of_states(partial(_structure, each.name), [corners_m(each.surface)])
            for each in content.structures
        }

    def match(self, content: SessionContent) -> bool:
        """True if they were created from the surfaces of ``content``."""
        return self._made_of == _surfaces(content)

    @property
    def structures(self) -> tuple[str, ...]:
        """Names of the further structures."""
        return tuple(self._structures)

    def structure(self, name: str, state: MarginState) -> bytes:
        """Serialised ``MarkerArray`` of a further structure, in the colour of its ``state``."""
        return self._structures[name][state]

    def surfaces(self, state: MarginState) -> bytes:
        """Serialised ``MarkerArray`` of the tumour, in the colour of ``state``, and of the tool.

        Both are a TRIANGLE_LIST.
        """
        return self._surfaces[state]

    def text(
        self, decision: FixtureDecision, governing: str = "", warnings: Sequence[str] = ()
    ) -> bytes:
        """Serialised ``MarkerArray`` of `margin_text` and ``warnings``, above the tumour.

        In the colour of the state.
        """
        key = (decision.state, margin_text(decision, governing), tuple(warnings))
        known = self._texts.get(key)
        if known is None:
            if len(self._texts) >= _MAX_TEXTS:
                self._texts.clear()
            self._text.color = color_message(decision.state.color)
            self._text.text = "\n".join([key[1], *warnings])
            known = bytes(serialize_message(MarkerArray(markers=[self._text])))
            self._texts[key] = known
        return known


def _surfaces(content: SessionContent) -> list[SurfaceMesh | None]:
    return [content.tumor, content.tool, *(each.surface for each in content.structures)]


def _of_states(
    markers: Callable[[ColorRGBA], MarkerArray], points_m: Sequence[FloatArray]
) -> dict[MarginState, bytes]:
    """The serialised markers of each state, by ``markers(color)`` with its colour."""
    return {
        state: serialized(markers(color_message(state.color, TUMOR_ALPHA)), points_m)
        for state in MarginState
    }
