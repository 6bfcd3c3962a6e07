"""Obstacles that other nodes report, as bodies for plans.

================  ===================================  ===========================================
``~/obstacles``   visualization_msgs/MarkerArray       SPHERE, CUBE, CYLINDER and TRIANGLE_LIST, by
                                                       ``ns`` and ``id``: ADD, DELETE, DELETEALL
``/tf``           tf2_msgs/TFMessage                   frames of ``frame_locked`` markers
================  ===================================  ===========================================

An obstacle stays until its sender deletes it, or, when that has left, another one: lifetimes are
not applied. One that cannot be used is a problem until it is corrected or deleted, a lost message
until a DELETEALL. Surfaces contain the ideal shapes.
"""

import math
import threading
import time
from collections.abc import Callable, Mapping
from functools import cache, partial
from typing import NamedTuple

import numpy as np
from builtin_interfaces.msg import Time
from numpy.typing import NDArray
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message
from rclpy.topic_endpoint_info import TopicEndpointInfo
from visualization_msgs.msg import Marker, MarkerArray

from app.bridge.message_origin import Origin
from app.bridge.messages import MM_PER_M, pose_of
from app.bridge.node import RosNode
from app.bridge.sender_names import SenderNames, node_name
from app.bridge.tf import TransformBuffer
from app.bridge.tf_topics import TfListener
from app.bridge.topics import INCOMING, Topic
from app.geometry import (
    NS_PER_MS,
    FloatArray,
    FrameError,
    Freshness,
    FreshnessLimits,
    InputError,
    MarginGuardError,
    SurfaceMesh,
    Transform,
    freshness_of,
)
from app.geometry.mesh import weld_vertices
from app.robot.primitives import SIDES, box, cylinder, sphere

TOPIC = "~/obstacles"
MAX_OBSTACLES, MAX_TRIANGLES = 64, 5000
_MAX_BYTES = 1 << 20
_MAX_MM = 10_000.0
_SHAPES = {Marker.SPHERE: "SPHERE", Marker.CUBE: "CUBE", Marker.CYLINDER: "CYLINDER"}
_TF_LIMITS = FreshnessLimits(200 * NS_PER_MS)
_LOOK_S = 0.2
"""Time between two looks at the publishers."""
_Key = tuple[bytes | None, str | None, int]
"""Sender, namespace and id; the namespace is None for a problem of messages of the sender."""


class Obstacle(NamedTuple):
    """``surface`` is in its own frame, that of the marker's header.

    With ``follows_tf`` it moves with this frame.
    """

    name: str
    surface: SurfaceMesh
    follows_tf: bool = False


class Obstacles:
    """Receives the obstacles. Thread-safe. ``clock_ns`` is that of tf's stamps."""

    def __init__(self, ros: RosNode, clock_ns: Callable[[], int] = time.time_ns) -> None:
        self._ros, self._lock, self._clock_ns = ros, threading.Lock(), clock_ns
        self._tf, self._hears_tf = TransformBuffer(), False
        self._markers: dict[_Key, Marker] = {}
        """The last ones, usable or not: an equal one changes nothing."""
        self._found: dict[_Key, Obstacle | str] = {}
        self._last: dict[bytes | None, int] = {}
        self._listed: set[bytes | None] = set()
        """Senders that the graph has listed: only these can leave."""
        self._best_effort: set[bytes] = set()
        self.revision = 0
        """Changes with each obstacle, and with the senders that cannot be used."""
        self._name = ros.node.resolve_topic_name(TOPIC)
        self._senders = SenderNames(ros, self._name)
        self._hears_latched = False
        self._subscribe(is_latched=False)
        ros.every(_LOOK_S, self._look)

    def current(self) -> list[Obstacle]:
        """The obstacles now, each with another name.

        Raises `InputError` while one of them cannot be used.
        """
        for info in filter(_is_best_effort, self._infos()):
            raise InputError(
                f"{self._name}: node {node_name(info)} sends with best effort; expected "
                "reliable messages"
            )
        with self._lock:
            found = list(self._found.values())
        named: dict[str, Obstacle] = {}
        for each in found:
            if isinstance(each, str):
                raise InputError(each)
            name, number = each.name, 1
            while name in named:  # of another sender
                number += 1
                name = f"{each.name} ({number})"
            named[name] = each._replace(name=name)
        return list(named.values())

    def tf_pose(self, obstacle: Obstacle, frame: str) -> Transform:
        """Newest ``frame_from_obstacle`` in tf; raises `FrameError` for an unknown or old one."""
        source, what = obstacle.surface.frame, f"obstacle {obstacle.name!r}"
        try:
            found = self._tf.lookup(frame, source)
        except MarginGuardError as error:
            raise FrameError(f"{what}: {error}; expected the frame in tf") from error
        now_ns = self._clock_ns()
        age_ns = 0 if found.stamp_ns is None else now_ns - found.stamp_ns
        if freshness_of(now_ns - age_ns, now_ns, _TF_LIMITS) is not Freshness.VALID:
            raise FrameError(
                f"{what}: frame {source!r} is {age_ns / NS_PER_MS:.0f} ms old in tf; expected 0 to "
                f"{_TF_LIMITS.stale_after_ns / NS_PER_MS:g} ms"
            )
        return found.transform

    def _subscribe(self, *, is_latched: bool) -> None:
        durability = DurabilityPolicy.TRANSIENT_LOCAL if is_latched else DurabilityPolicy.VOLATILE
        qos = QoSProfile(
            history=HistoryPolicy.KEEP_ALL,
            reliability=ReliabilityPolicy.RELIABLE,
            durability=durability,
        )
        self._ros.subscribe_with_origin(
            Topic(TOPIC, MarkerArray, qos), partial(self._take, is_latched=is_latched)
        )

    def _look(self) -> None:
        """Look for senders with best effort, and for what latched ones have sent before.

        That is not subscribed from the beginning: each other publisher would warn of an
        incompatible subscription.
        """
        infos = self._infos()
        best_effort = {bytes(each.endpoint_gid) for each in filter(_is_best_effort, infos)}
        if best_effort != self._best_effort:
            self._best_effort = best_effort
            with self._lock:
                self.revision += 1
        if not self._hears_latched and any(map(_is_latched, infos)):
            self._hears_latched = True
            self._subscribe(is_latched=True)

    def _infos(self) -> list[TopicEndpointInfo]:
        return self._ros.node.get_publishers_info_by_topic(self._name)

    def _take(self, data: bytes, origin: Origin, *, is_latched: bool) -> None:
        if (
            not is_latched
            and self._hears_latched
            and any(
                bytes(info.endpoint_gid) == origin.sender
                for info in filter(_is_latched, self._infos())
            )
        ):
            return  # the other subscription gets it
        with self._lock:
            before = dict(self._found)
            self._senders.refresh()
            if self._senders.is_present(origin.sender):
                self._listed.add(origin.sender)
            try:
                self._count(origin)
                if len(data) > _MAX_BYTES:
                    raise InputError(f"{len(data)} bytes; expected at most {_MAX_BYTES}")
                for marker in deserialize_message(data, MarkerArray).markers:
                    self._apply(marker, origin.sender)
            except Exception as error:  # rclpy raises several unrelated types for invalid bytes
                self._set(
                    (origin.sender, None, 0),
                    f"obstacles: a message cannot be read ({error}); expected a MarkerArray, after "
                    "a DELETEALL",
                )
            if self._found != before:
                self.revision += 1

    def _count(self, origin: Origin) -> None:
        """Find lost messages: the numbers of a sender have a gap; latched ones come again."""
        if origin.sequence is None:  # Cyclone DDS
            return
        lost = origin.sequence - self._last.get(origin.sender, origin.sequence) - 1
        self._last[origin.sender] = origin.sequence
        if lost > 0:
            text = f"obstacles: {lost} messages are lost; expected all, after a DELETEALL"
            self._set((origin.sender, None, 1), text)

    def _apply(self, marker: Marker, sender: bytes | None) -> None:
        key, name = (sender, marker.ns, marker.id), f"{marker.ns}/{marker.id}"
        if marker.action in (Marker.DELETE, Marker.DELETEALL):
            self._delete(marker, sender)
        elif key not in self._found and len(self._found) >= MAX_OBSTACLES:
            text = f"obstacles: are more than {MAX_OBSTACLES}; expected fewer, after a DELETEALL"
            self._set((sender, None, 2), text)
        else:
            marker.header.stamp = Time()
            # Not the serialised ones: their padding is memory that was used before.
            if self._markers.get(key) == marker:
                return
            self._markers[key] = marker
            if marker.frame_locked and not self._hears_tf:
                self._hears_tf = True
                TfListener(self._ros, self._tf, clock=False, qos=INCOMING)
            try:
                self._found[key] = obstacle_of(name, marker)
            except MarginGuardError as error:
                self._set(key, f"obstacle {name!r}: {error}")

    def _delete(self, marker: Marker, sender: bytes | None) -> None:
        """Delete what ``marker`` names of ``sender``, and of senders that have left."""
        for key in list(self._found):
            owner, ns, number = key
            has_left = owner in self._listed and not self._senders.is_present(owner)
            if owner != sender and not has_left:
                continue
            if marker.action == Marker.DELETEALL:
                is_named = marker.ns in ("", ns)
            else:
                is_named = (ns, number) == (marker.ns, marker.id)
            if is_named:
                del self._found[key]
                self._markers.pop(key, None)

    def _set(self, key: _Key, problem: str) -> None:
        if self._found.get(key) != problem:
            self._ros.warn(f"{self._name}: {problem}; nothing is planned until then")
        self._found[key] = problem


def _is_latched(info: TopicEndpointInfo) -> bool:
    return info.qos_profile.durability is DurabilityPolicy.TRANSIENT_LOCAL


def _is_best_effort(info: TopicEndpointInfo) -> bool:
    return info.qos_profile.reliability is ReliabilityPolicy.BEST_EFFORT


def obstacle_of(name: str, marker: Marker) -> Obstacle:
    """The body of a ``marker``. Raises `MarginGuardError` for one that cannot be used."""
    if marker.action != Marker.ADD:
        raise InputError(f"action is {marker.action}; expected ADD, DELETE or DELETEALL")
    scale_mm = MM_PER_M * np.array([marker.scale.x, marker.scale.y, marker.scale.z])
    if not ((scale_mm > 0.0) & (scale_mm <= MM_PER_M * _MAX_MM)).all():
        raise InputError(f"scale is {(scale_mm / MM_PER_M).tolist()} m; expected numbers above 0")
    frame = marker.header.frame_id
    if not frame:
        raise InputError("has no frame_id; expected the frame of its pose")
    if marker.type == Marker.TRIANGLE_LIST:
        vertices, faces = _triangles(marker)
    elif marker.type in _SHAPES:
        vertices, faces = _shapes()[marker.type]
    else:
        kinds = ", ".join(_SHAPES.values())
        raise InputError(f"type is {marker.type}; expected {kinds} or TRIANGLE_LIST")
    placed = pose_of(marker.pose, frame, "obstacle").apply(vertices * scale_mm)
    if not (np.abs(placed) <= _MAX_MM).all():
        raise InputError(
            f"is farther than {_MAX_MM / MM_PER_M:g} m from its frame; expected nearer"
        )
    surface = SurfaceMesh(frame, placed, faces.astype(np.int32))
    return Obstacle(name, surface.require_closed("its surface"), marker.frame_locked)


def _triangles(marker: Marker) -> tuple[FloatArray, NDArray[np.int64]]:
    """Vertices in units of the scale, and faces."""
    points = np.array([[each.x, each.y, each.z] for each in marker.points]).reshape(-1, 3)
    count, rest = divmod(len(points), 3)
    if rest or not 0 < count <= MAX_TRIANGLES or not np.isfinite(points).all():
        raise InputError(
            f"has {len(points)} points; expected finite corners of 1 to {MAX_TRIANGLES} triangles"
        )
    vertices, faces, _ = weld_vertices(points, np.arange(len(points)).reshape(-1, 3))
    return vertices, faces


@cache
def _shapes() -> Mapping[int, tuple[FloatArray, NDArray[np.int64]]]:
    """Shapes of size 1 around the ideal ones."""
    ball, ball_faces = sphere(0.5)
    corners = ball[ball_faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    inside = float((normals * corners[:, 0]).sum(axis=1).min())  # nearest face of the ball
    rod, rod_faces = cylinder(0.5, 1.0)
    around = np.array([1.0, 1.0, math.cos(math.pi / SIDES)]) / math.cos(math.pi / SIDES)
    return {
        Marker.SPHERE: (ball * (0.5 / inside), ball_faces),
        Marker.CUBE: box((1.0, 1.0, 1.0)),
        Marker.CYLINDER: (rod * around, rod_faces),
    }
