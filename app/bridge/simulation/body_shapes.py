"""Surfaces of what a simulated world consists of, for pages and RViz: ``~/bodies``."""

import numpy as np
from geometry_msgs.msg import Pose, Quaternion
from numpy.typing import NDArray
from std_msgs.msg import Header
from visualization_msgs.msg import Marker, MarkerArray

from app.bridge.messages import color_message, metres
from app.bridge.node import RosNode
from app.bridge.publishing.marker_points import (
    MAX_TRIANGLES,
    placeholder,
    serialized,
    simplified,
)
from app.bridge.qos import LATCHED, Topic
from app.bridge.world_editor import BODIES, TRUTH
from app.geometry import FloatArray, SurfaceMesh
from app.runtime import BodyKind
from app.simulation import BodyEntry, WorldDescription

MAX_ALL_TRIANGLES = 400_000
"""Largest number of triangles in one message, which takes 72 bytes for each."""

_RGB = (0.72, 0.69, 0.62)


class BodyShapes:
    """Publishes the bodies, tissues and tools of a world as TRIANGLE_LIST markers, latched.

    Each is locked to its frame ``truth/NAME``; ``ns`` is its name, ``text`` its `BodyKind`. The
    first marker is DELETEALL, so that RViz drops what was removed. Large surfaces are simplified.
    """

    def __init__(self, ros: RosNode, description: WorldDescription) -> None:
        self._given = description.bodies
        self._publisher = ros.publisher(Topic(f"~/{BODIES}", MarkerArray, LATCHED))
        self.publish(description)

    def publish(self, description: WorldDescription) -> None:
        """Publish what the world consists of now."""
        shapes: list[tuple[str, BodyKind, SurfaceMesh]] = [
            *((each.name, self._kind(each), each.mesh) for each in description.bodies),
            *((each.name, BodyKind.TISSUE, each.mesh) for each in description.tissues),
            *(
                (each.tool.name, BodyKind.TOOL, each.tool.mesh)
                for each in description.robots
                if each.tool is not None
            ),
        ]
        share = min(MAX_TRIANGLES, MAX_ALL_TRIANGLES // max(len(shapes), 1))
        markers = [Marker(action=Marker.DELETEALL)]
        markers += [_marker(name, kind, n) for n, (name, kind, _) in enumerate(shapes)]
        points_m = [_corners_m(mesh, share) for _, _, mesh in shapes]
        self._publisher.publish(serialized(MarkerArray(markers=markers), points_m))

    def _kind(self, body: BodyEntry) -> BodyKind:
        if not any(body is each for each in self._given):
            return BodyKind.ADDED
        return BodyKind.FIXED if body.mass_kg is None else BodyKind.FREE


def _corners_m(mesh: SurfaceMesh, max_faces: int) -> FloatArray:
    """Corners (3 m, 3) of at most ``max_faces`` faces, in m."""
    vertices: FloatArray = mesh.vertices_mm
    faces: NDArray[np.integer] = mesh.faces
    if len(faces) > max_faces:
        vertices, faces = simplified(vertices, faces, max_faces)
    return metres(vertices[faces.reshape(-1)])


def _marker(name: str, kind: BodyKind, number: int) -> Marker:
    marker = Marker(
        header=Header(frame_id=f"{TRUTH}{name}"),
        ns=name,
        type=Marker.TRIANGLE_LIST,
        action=Marker.ADD,
        pose=Pose(orientation=Quaternion(w=1.0)),
        color=color_message(_RGB),
        frame_locked=True,
        points=[placeholder(number)],
        text=str(kind),
    )
    marker.scale.x = marker.scale.y = marker.scale.z = 1.0
    return marker
