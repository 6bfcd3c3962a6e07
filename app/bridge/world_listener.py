"""Follows a simulated world and sends edits of its bodies: the ROS side of `SimulatedWorld`."""

import numpy as np
from visualization_msgs.msg import Marker, MarkerArray

from app.bridge import topics
from app.bridge.marker_reader import MarkerShape, read_marker_array
from app.bridge.messages import MM_PER_M
from app.bridge.node import RosNode
from app.bridge.qos import INCOMING_TF, LATCHED, Topic
from app.bridge.tf.wire import TfMessageReader
from app.bridge.world_editor import BODIES, TRUTH, WORLD, WorldEditor
from app.geometry import MarginGuardError, SurfaceMesh, check_frame
from app.geometry.welding import weld_vertices
from app.runtime import BodyKind, SimulatedWorld, WorldBody

PAGE_NODE = "marginguard_page"
"""Name of the node of a page that shows a simulated world."""

_MAX_BYTES = 40 << 20
_MAX_PLACES = 256


class WorldListener:
    """Gives ``world`` what the node ``simulation`` publishes, and takes its requests.

    All of it happens in the thread of ``ros``. Messages that are invalid are left out.
    """

    def __init__(self, ros: RosNode, simulation: str, world: SimulatedWorld) -> None:
        name = simulation.strip("/")
        self._ros, self._world = ros, world
        self._read = TfMessageReader()
        ros.subscribe(Topic(f"/{name}/{BODIES}", MarkerArray, LATCHED), self._take_bodies, raw=True)
        ros.subscribe(Topic(topics.TF.name, topics.TF.type, INCOMING_TF), self._take_tf, raw=True)
        world.connect(WorldEditor(ros, name, world.refused))

    def _take_tf(self, data: bytes) -> None:
        if TRUTH.encode() not in data:
            return
        try:
            samples = self._read(data)
        except MarginGuardError as error:
            self._ros.warn(f"a pose of the simulated world was left out: {error}")
            return
        places = {
            each.child.removeprefix(TRUTH): each.pose
            for each in samples[:_MAX_PLACES]
            if each.parent == WORLD and each.child.startswith(TRUTH)
        }
        if places:
            self._world.set_places(places, samples[0].stamp_ns)

    def _take_bodies(self, data: bytes) -> None:
        try:
            if len(data) > _MAX_BYTES:
                raise MarginGuardError(f"{len(data)} bytes; expected at most {_MAX_BYTES}")
            shapes = read_marker_array(data)
            bodies = [_body(each) for each in shapes if each.action == Marker.ADD]
        except MarginGuardError as error:
            self._ros.warn(f"the surfaces of the simulated world were left out: {error}")
            return
        self._world.set_bodies(bodies)


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
