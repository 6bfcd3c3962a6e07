"""Receives the surfaces of what a simulated world consists of: ``~/bodies`` of its node."""

from collections.abc import Callable

import numpy as np
from visualization_msgs.msg import Marker, MarkerArray

from app.bridge.marker_reader import MarkerShape, read_marker_array
from app.bridge.messages import MM_PER_M
from app.bridge.node import RosNode
from app.bridge.qos import LATCHED, Topic
from app.bridge.world_editor import BODIES
from app.geometry import MarginGuardError, SurfaceMesh, check_frame
from app.geometry.mesh import weld_vertices
from app.runtime import BodyKind, WorldBody

_MAX_BYTES = 40 << 20


class BodySurfaces:
    """Calls ``on_bodies`` with all bodies of the node ``simulation`` when they are others.

    In the thread of ``ros``. A message that is invalid is left out, with a warning in the log.
    """

    def __init__(
        self, ros: RosNode, simulation: str, on_bodies: Callable[[list[WorldBody]], None]
    ) -> None:
        self._ros, self._on_bodies = ros, on_bodies
        topic = Topic(f"/{simulation.strip('/')}/{BODIES}", MarkerArray, LATCHED)
        self._subscription = ros.subscribe(topic, self._take, raw=True)

    def close(self) -> None:
        """Receive nothing more; from any thread."""
        self._ros.call(lambda: self._ros.destroy_subscription(self._subscription))

    def _take(self, data: bytes) -> None:
        try:
            if len(data) > _MAX_BYTES:
                raise MarginGuardError(f"{len(data)} bytes; expected at most {_MAX_BYTES}")
            shapes = read_marker_array(data)
            bodies = [_body(each) for each in shapes if each.action == Marker.ADD]
        except MarginGuardError as error:
            self._ros.warn(f"the surfaces of the simulated world were left out: {error}")
            return
        self._on_bodies(bodies)


def _body(shape: MarkerShape) -> WorldBody:
    """Raises `MarginGuardError` for a marker that describes none."""
    kinds = [each for each in BodyKind if str(each) == shape.text]
    count, rest = divmod(len(shape.points_m), 3)
    if not kinds or shape.type != Marker.TRIANGLE_LIST or rest or not count:
        raise MarginGuardError(
            f"marker {shape.name!r}: {shape.text!r}, {len(shape.points_m)} points; expected "
            f"triangles, and one of {', '.join(BodyKind)}"
        )
    if not np.isfinite(shape.points_m).all():
        raise MarginGuardError(f"marker {shape.name!r}: not finite; expected finite points")
    corners = np.arange(3 * count).reshape(-1, 3)
    vertices, faces, _ = weld_vertices(MM_PER_M * shape.points_m, corners)
    name = check_frame(shape.name)
    return WorldBody(name, kinds[0], SurfaceMesh(name, vertices, faces.astype(np.int32)))
