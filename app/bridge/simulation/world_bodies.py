"""Bodies of a simulated world: their surfaces, and requests to move, add and remove them.

==================== ============================== ===============================================
``~/move_bodies``    tf2_msgs/TFMessage             ``world`` to ``NAME``: places of bodies, all or
                                                    none of a message
``~/edit_body``      visualization_msgs/Marker      ADD a fixed body ``ns`` (TRIANGLE_LIST in its
                                                    frame, m), or DELETE one
``~/refused_edits``  std_msgs/String                why a request was refused
``~/bodies``         visualization_msgs/MarkerArray surfaces, for pages and RViz
==================== ============================== ===============================================

The stamp of a request is the time of the user's edit: at most `MAX_AGE_NS` old, and later than that
of the last edit of the body. The simulation owns the frames: no other node may publish them on
``/tf``.
"""

import threading
import time
from collections import deque
from collections.abc import Callable

import numpy as np
from rclpy.serialization import deserialize_message
from std_msgs.msg import String
from tf2_msgs.msg import TFMessage
from visualization_msgs.msg import Marker, MarkerArray

from app.bridge.messages import MM_PER_M, color_message, ns_of, pose_of
from app.bridge.node import RosNode
from app.bridge.publishing.markers import MAX_TRIANGLES, corners_m, serialized, surface_marker
from app.bridge.ros_errors import BridgeError
from app.bridge.tf_poses import TfMessageReader
from app.bridge.topics import INCOMING_TF, LATCHED, STREAM, Topic
from app.bridge.world_client import BODIES, TRUTH
from app.geometry import (
    NS_PER_MS,
    NS_PER_S,
    MarginGuardError,
    SurfaceMesh,
    Transform,
    check_frame,
)
from app.geometry.mesh import weld_vertices
from app.runtime import MAX_BODY_TRIANGLES, BodyKind
from app.runtime.requests import RateLimit
from app.simulation import BodyEntry, EditError, World, WorldDescription

MAX_AGE_NS, MAX_AHEAD_NS = NS_PER_S, 5 * NS_PER_MS
MAX_MOVES, MAX_BODIES = 64, 64
MAX_PLACE_MM = 10_000.0
MOVES_PER_S, MOVES_BURST = 500.0, 100.0
CHANGES_PER_S, CHANGES_BURST = 2.0, 10.0
_MAX_MOVE_BYTES, _MAX_MARKER_BYTES = 1 << 16, 1 << 19
_MAX_WAITING = 16
_MAX_TEXT = 300

Edit = Callable[[World], str]
"""Changes a world; returns which body was added or removed, empty for a move."""

MAX_ALL_TRIANGLES = 400_000
"""Largest number of triangles in one message, which takes 72 bytes for each."""

_RGB = (0.72, 0.69, 0.62)


class BodyEdits:
    """Receives requests in the thread of ``ros``; `apply` them in the thread of the physics."""

    def __init__(self, ros: RosNode) -> None:
        self._ros = ros
        self._lock = threading.Lock()
        self._waiting: deque[tuple[int, tuple[str, ...], Edit]] = deque()
        self._last_ns: dict[str, int] = {}
        self._read = TfMessageReader()
        self._moves = RateLimit(MOVES_PER_S, MOVES_BURST)
        self._changes = RateLimit(CHANGES_PER_S, CHANGES_BURST)
        self.applied = self.refused = 0
        """Numbers of requests."""
        self._refusals = ros.publisher(Topic("~/refused_edits", String, STREAM))
        ros.subscribe(
            Topic("~/move_bodies", TFMessage, INCOMING_TF),
            lambda data: self._receive(self._move, self._moves, _MAX_MOVE_BYTES, data),
            raw=True,
        )
        ros.subscribe(
            Topic("~/edit_body", Marker, INCOMING_TF),
            lambda data: self._receive(self._change, self._changes, _MAX_MARKER_BYTES, data),
            raw=True,
        )

    def apply(self, world: World, host_ns: int) -> list[str]:
        """Apply what has arrived; ``host_ns`` is the present. Returns what was added or removed."""
        done: list[str] = []
        while True:
            with self._lock:
                if not self._waiting:
                    return done
                stamp_ns, names, edit = self._waiting.popleft()
            try:
                self._check_stamp(stamp_ns, names, host_ns)
                change = edit(world)
            except MarginGuardError as error:
                self._refuse(str(error))
                continue
            self._last_ns |= dict.fromkeys(names, stamp_ns)
            self.applied += 1
            if change:
                done.append(change)

    def _receive(
        self,
        read: Callable[[bytes], tuple[int, tuple[str, ...], Edit]],
        limit: RateLimit,
        max_bytes: int,
        data: bytes,
    ) -> None:
        try:
            if not limit.take(time.monotonic_ns()):
                raise EditError("request: too many a second; expected fewer")
            if len(data) > max_bytes:
                raise EditError(
                    f"request: {len(data)} bytes; expected at most {max_bytes}: "
                    f"{MAX_MOVES} places, or {MAX_BODY_TRIANGLES} triangles"
                )
            edit = read(data)
            self._check_ahead(*edit[:2])
            with self._lock:
                if len(self._waiting) >= _MAX_WAITING:
                    raise EditError(f"request: {_MAX_WAITING} wait already; expected fewer")
                self._waiting.append(edit)
        except MarginGuardError as error:
            self._refuse(str(error))

    def _move(self, data: bytes) -> tuple[int, tuple[str, ...], Edit]:
        samples = self._read(data)
        if not 0 < len(samples) <= MAX_MOVES:
            raise EditError(f"move: {len(samples)} places; expected 1 to {MAX_MOVES}")
        poses = {
            each.child: _placed(
                Transform.from_quaternion(
                    each.pose[3:], each.pose[:3], target=each.parent, source=each.child
                )
            )
            for each in samples
        }
        if len(poses) < len(samples):
            raise EditError("move: a body is named twice; expected one place for each")

        def edit(world: World) -> str:
            world.move_bodies(poses)
            return ""

        return min(each.stamp_ns for each in samples), tuple(poses), edit

    def _change(self, data: bytes) -> tuple[int, tuple[str, ...], Edit]:
        try:
            marker = deserialize_message(data, Marker)
        except Exception as error:  # rclpy raises several unrelated types for invalid bytes
            raise BridgeError("edit: the message cannot be read; expected a Marker") from error
        name = check_frame(marker.ns)
        stamp_ns = ns_of(marker.header.stamp)
        if marker.action == Marker.DELETE:
            return stamp_ns, (name,), lambda world: _remove(world, name)
        if marker.action != Marker.ADD or marker.type != Marker.TRIANGLE_LIST:
            raise EditError(
                f"edit of {name!r}: action {marker.action}, type {marker.type}; expected DELETE, "
                "or ADD with TRIANGLE_LIST"
            )
        entry = _entry(name, marker)
        return stamp_ns, (name,), lambda world: _add(world, entry)

    def _check_ahead(self, stamp_ns: int, names: tuple[str, ...]) -> None:
        """Refuse a stamp of the future. At its arrival: the physics may have been interrupted."""
        ahead_ns = stamp_ns - self._ros.node.get_clock().now().nanoseconds
        if ahead_ns > MAX_AHEAD_NS:
            raise EditError(
                f"edit of {names[0]!r}: stamp is {ahead_ns / NS_PER_MS:.0f} ms in the future; "
                "expected the past"
            )

    def _check_stamp(self, stamp_ns: int, names: tuple[str, ...], host_ns: int) -> None:
        age_ns = host_ns - stamp_ns
        if age_ns > MAX_AGE_NS:
            raise EditError(
                f"edit of {names[0]!r}: stamp is {age_ns / NS_PER_MS:.0f} ms old; expected at most "
                f"{MAX_AGE_NS // NS_PER_MS} ms"
            )
        late = next((n for n in names if stamp_ns <= self._last_ns.get(n, stamp_ns - 1)), None)
        if late is not None:
            raise EditError(f"edit of {late!r}: not later than the last one; expected a new stamp")

    def _refuse(self, reason: str) -> None:
        self.refused += 1
        text = reason[:_MAX_TEXT]
        self._refusals.publish(String(data=text))
        self._ros.node.get_logger().warning(
            f"an edit of a body was refused: {text}", throttle_duration_sec=1.0
        )


def _placed(pose: Transform) -> Transform:
    if float(np.abs(pose.translation_mm).max()) > MAX_PLACE_MM:
        raise EditError(
            f"body {pose.source!r} is placed at {pose.translation_mm.tolist()} mm; expected at "
            f"most {MAX_PLACE_MM:g} mm from the origin"
        )
    return pose


def _entry(name: str, marker: Marker) -> BodyEntry:
    """The fixed body that ``marker`` describes. Raises `MarginGuardError`."""
    points = np.array([[each.x, each.y, each.z] for each in marker.points]).reshape(-1, 3)
    count, rest = divmod(len(points), 3)
    if rest or not 0 < count <= MAX_BODY_TRIANGLES:
        raise EditError(
            f"mesh of {name!r}: {len(points)} points; expected three for each of 1 to "
            f"{MAX_BODY_TRIANGLES} triangles"
        )
    if not np.isfinite(points).all() or float(np.abs(points).max()) * MM_PER_M > MAX_PLACE_MM:
        raise EditError(
            f"mesh of {name!r}: a point is not finite or more than {MAX_PLACE_MM:g} mm from the "
            "origin; expected a surface in m"
        )
    vertices, faces, _ = weld_vertices(MM_PER_M * points, np.arange(3 * count).reshape(-1, 3))
    pose = pose_of(marker.pose, check_frame(marker.header.frame_id), name)
    return BodyEntry(name, SurfaceMesh(name, vertices, faces.astype(np.int32)), _placed(pose), None)


def _add(world: World, entry: BodyEntry) -> str:
    about, name = world.description, entry.name
    used = {*world.state().bodies, *(each.name for each in about.robots), "world"}
    if name in used:
        raise EditError(f"body {name!r}: the name is in use; expected another one")
    if entry.world_from_body.target != "world":
        raise EditError(
            f"body {name!r} is placed in frame {entry.world_from_body.target!r}; expected 'world'"
        )
    if len(about.bodies) >= MAX_BODIES:
        raise EditError(f"body {name!r}: the world has {MAX_BODIES}; expected fewer")
    world.change_bodies((*about.bodies, entry))
    return f"body {name!r} was added"


def _remove(world: World, name: str) -> str:
    bodies = world.description.bodies
    if name not in {each.name for each in bodies}:
        raise EditError(
            f"{name!r} cannot be removed; expected one of "
            f"{', '.join(each.name for each in bodies) or 'none'}"
        )
    world.change_bodies(tuple(each for each in bodies if each.name != name))
    return f"body {name!r} was removed"


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
        for number, (name, kind, _) in enumerate(shapes):
            marker = surface_marker(name, f"{TRUTH}{name}", color_message(_RGB), number)
            marker.text = str(kind)
            markers.append(marker)
        points_m = [corners_m(mesh, share) for _, _, mesh in shapes]
        self._publisher.publish(serialized(MarkerArray(markers=markers), points_m))

    def _kind(self, body: BodyEntry) -> BodyKind:
        if not any(body is each for each in self._given):
            return BodyKind.ADDED
        return BodyKind.FIXED if body.mass_kg is None else BodyKind.FREE
