"""Clients of a simulated world: receive and edit its bodies, publish the wrench of a hand."""

import struct
from collections.abc import Callable, Iterable
from typing import NamedTuple

import numpy as np
from geometry_msgs.msg import Point, WrenchStamped
from std_msgs.msg import String
from tf2_msgs.msg import TFMessage
from visualization_msgs.msg import Marker, MarkerArray

from app.bridge import topics
from app.bridge.messages import (
    MM_PER_M,
    header_message,
    metres,
    point_message,
    quaternion_message,
    vector_message,
)
from app.bridge.node import RosNode
from app.bridge.ros_errors import BridgeError
from app.bridge.tf_poses import TfMessageReader, TfSample, write_tf_message
from app.bridge.topics import INCOMING_TF, LATCHED, NEWEST, STREAM, Topic
from app.geometry import (
    FloatArray,
    MarginGuardError,
    Stamp,
    SurfaceMesh,
    Transform,
    check_frame,
    quaternion_of_rotation,
)
from app.geometry.mesh import weld_vertices
from app.runtime import BodyKind, SimulatedWorld, WorldBody

SIMULATION = "marginguard_simulation"
"""Name of the node of ``marginguard simulate``."""
WORLD = "world"
TRACKER = "tracker"
"""Frame of the simulated tracker, which has the pose of `WORLD`."""
BODIES = "bodies"
"""Topic of the simulation with the surfaces of its bodies."""
TRUTH = "truth/"
"""Prefix of the frames of true poses."""

_HEADER_BYTES = 4
_POINT_BYTES, _COLOR_BYTES, _UV_BYTES = 24, 16, 8
_MAX_MARKERS = 1024
_FIXED = struct.Struct("<iii")

_MAX_BYTES = 40 << 20

_MAX_PLACES = 256

HAND_NODE = "marginguard_hand"
_HAND_PERIOD_S = 0.01
"""A controller does not use a wrench that is older than 30 ms."""


class WorldEditor:
    """Requests to the simulation node ``simulation``; the stamp is the time of the user's edit.

    ``on_refused(reason)`` is called in the thread of ``ros``, also for requests of others.
    """

    def __init__(
        self, ros: RosNode, simulation: str, on_refused: Callable[[str], None] | None = None
    ) -> None:
        name = f"/{simulation.strip('/')}"
        self._ros = ros
        self._moves = ros.publisher(Topic(f"{name}/move_bodies", TFMessage, STREAM))
        self._changes = ros.publisher(Topic(f"{name}/edit_body", Marker, STREAM))
        self._refusals = None
        if on_refused is not None:
            self._refusals = ros.subscribe(
                Topic(f"{name}/refused_edits", String, STREAM), lambda each: on_refused(each.data)
            )

    def close(self) -> None:
        """Leave the graph; from any thread."""
        self._ros.call(self._destroy)

    def _destroy(self) -> None:
        self._ros.destroy_publisher(self._moves)
        self._ros.destroy_publisher(self._changes)
        if self._refusals is not None:
            self._ros.destroy_subscription(self._refusals)

    def is_connected(self) -> bool:
        """True if a simulation receives the requests."""
        return min(self._moves.get_subscription_count(), self._changes.get_subscription_count()) > 0

    def move(self, poses: Iterable[Transform], stamp: Stamp) -> None:
        """Request ``world_from_body`` of some bodies, all at once."""
        self._moves.publish(write_tf_message(tf_sample(each, stamp) for each in poses))

    def add(self, mesh: SurfaceMesh, world_from_body: Transform, stamp: Stamp) -> None:
        """Request a fixed body with the surface ``mesh``, which is in the body's frame."""
        marker = self._marker(world_from_body.source, Marker.ADD, world_from_body.target, stamp)
        marker.type = Marker.TRIANGLE_LIST
        marker.pose.position = point_message(world_from_body.translation_mm)
        marker.pose.orientation = quaternion_message(world_from_body)
        corners = metres(mesh.vertices_mm)[mesh.faces].reshape(-1, 3).tolist()
        marker.points = [Point(x=x, y=y, z=z) for x, y, z in corners]
        self._changes.publish(marker)

    def remove(self, name: str, stamp: Stamp) -> None:
        """Request the end of a body."""
        self._changes.publish(self._marker(name, Marker.DELETE, WORLD, stamp))

    @staticmethod
    def _marker(name: str, action: int, frame: str, stamp: Stamp) -> Marker:
        marker = Marker(header=header_message(frame, stamp), ns=name, action=action)
        marker.scale.x = marker.scale.y = marker.scale.z = 1.0
        marker.color.a = 1.0
        return marker


def tf_sample(pose: Transform, stamp: Stamp) -> TfSample:
    """``pose`` at ``stamp``, to be written by `write_tf_message`."""
    x, y, z = pose.translation_mm.tolist()
    place = (x, y, z, *quaternion_of_rotation(pose.rotation))
    return TfSample(pose.target, pose.source, stamp.ns, place)


class MarkerShape(NamedTuple):
    """A marker: what it is for, and its points (n, 3) in m."""

    action: int
    type: int
    name: str
    text: str
    points_m: FloatArray


def read_marker_array(data: bytes) -> list[MarkerShape]:
    """The markers of a little-endian message; raises `BridgeError` for other bytes."""
    try:
        return _Reader(data).markers()
    except (ValueError, struct.error) as error:
        raise BridgeError(
            f"markers: {len(data)} bytes cannot be read: {error}; expected a MarkerArray"
        ) from error


class _Reader:
    """A place in a message; alignment is counted from the end of its header."""

    def __init__(self, data: bytes) -> None:
        if data[:2] != b"\x00\x01":
            raise ValueError("not little-endian CDR")
        self._data, self._at = memoryview(data)[_HEADER_BYTES:], 0

    def markers(self) -> list[MarkerShape]:
        count = self._count()
        if count > _MAX_MARKERS:
            raise ValueError(f"{count} markers")
        return [self._marker() for _ in range(count)]

    def _marker(self) -> MarkerShape:
        self._skip(4, 8)  # stamp
        self._bytes()  # frame
        name = self._text()
        self._align(4)
        _, kind, action = _FIXED.unpack_from(self._data, self._at)
        self._at += _FIXED.size
        self._skip(8, 10 * 8)  # pose, scale
        self._skip(4, 4 * 4 + 8)  # colour, lifetime
        self._skip(1, 1)  # locked to its frame
        points = self._points()
        self._sequence(4, _COLOR_BYTES)
        self._bytes()  # texture
        self._skip(4, 8)
        self._bytes()
        self._bytes()
        self._sequence(1, 1)
        self._sequence(4, _UV_BYTES)
        text = self._text()
        self._bytes()  # mesh
        self._bytes()
        self._sequence(1, 1)
        self._skip(1, 1)
        return MarkerShape(action, kind, name, text, points)

    def _points(self) -> FloatArray:
        start, count = self._sequence(8, _POINT_BYTES)
        end = start + _POINT_BYTES * count
        points = np.frombuffer(self._data[start:end], dtype="<f8").reshape(-1, 3)
        return np.asarray(points, dtype=np.float64)

    def _sequence(self, alignment: int, item_bytes: int) -> tuple[int, int]:
        """Skip a sequence; where its items begin, and their number."""
        count = self._count()
        if count:
            self._align(alignment)
        start = self._at
        self._advance(item_bytes * count)
        return start, count

    def _text(self) -> str:
        return self._bytes().removesuffix(b"\0").decode()

    def _bytes(self) -> bytes:
        start, count = self._sequence(1, 1)
        return bytes(self._data[start : start + count])

    def _count(self) -> int:
        self._align(4)
        (count,) = struct.unpack_from("<I", self._data, self._at)
        self._at += 4
        return int(count)

    def _skip(self, alignment: int, size: int) -> None:
        self._align(alignment)
        self._advance(size)

    def _align(self, size: int) -> None:
        self._at = -(-self._at // size) * size

    def _advance(self, size: int) -> None:
        self._at += size
        if self._at > len(self._data):
            raise ValueError(f"{self._at - len(self._data)} of them are missing")


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


class WorldListener:
    """Gives ``world`` what the node ``simulation`` publishes, and takes its requests.

    All of it happens in the thread of ``ros``. Messages that are invalid are left out.
    """

    def __init__(self, ros: RosNode, simulation: str, world: SimulatedWorld) -> None:
        name = simulation.strip("/")
        self._ros, self._world = ros, world
        self._read = TfMessageReader()
        BodySurfaces(ros, name, world.set_bodies)
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


class HandPublisher:
    """Publishes ``force_n()`` on ``topic`` 100 times per second, in the thread of ``ros``.

    The force (3,) in N acts on the tool's tip, along the axes of ``frame``; the torque is 0. The
    stamp is the time of ``clock_ns``, the host's, at which it was computed. The last message, on
    `close`, has no force.
    """

    def __init__(
        self,
        ros: RosNode,
        topic: str,
        frame: str,
        force_n: Callable[[], FloatArray],
        *,
        clock_ns: Callable[[], int],
    ) -> None:
        self._frame, self._force_n, self._clock_ns = frame, force_n, clock_ns
        self._publisher = ros.publisher(Topic(topic, WrenchStamped, NEWEST))
        ros.every(_HAND_PERIOD_S, self._publish)
        ros.on_close(lambda: self._send((0.0, 0.0, 0.0)))

    def _publish(self) -> None:
        self._send(self._force_n())

    def _send(self, force_n: "FloatArray | tuple[float, float, float]") -> None:
        message = WrenchStamped(header=header_message(self._frame, Stamp(self._clock_ns())))
        message.wrench.force = vector_message(force_n)
        self._publisher.publish(message)
