"""The bodies of a simulated world, as a user sees and edits them."""

import math
import threading
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum
from typing import Protocol

import numpy as np

from app.geometry import (
    NS_PER_S,
    FloatArray,
    InputError,
    MarginGuardError,
    Stamp,
    SurfaceMesh,
    Transform,
)

ANSWER_NS = 2 * NS_PER_S
"""A request without an effect for this time has no answer."""
MAX_BODY_TRIANGLES = 5000
"""Largest number of triangles of a body that a user adds."""

_SAME_MM, _SAME = 0.01, 1e-4
_NEAR_MM = 2.0
"""Tolerance for a free body, which falls before its pose at the requested place is received."""

Place = tuple[float, float, float, float, float, float, float]
"""x, y, z in mm and the quaternion x, y, z, w, as received."""


class BodyKind(StrEnum):
    """Kind of a part of a world; ``ADDED`` is a fixed body that its file does not have."""

    FIXED = "fixed body"
    FREE = "free body"
    ADDED = "added body"
    TISSUE = "tissue"
    TOOL = "tool"

    @property
    def is_body(self) -> bool:
        """True if a user may move it."""
        return self not in (BodyKind.TISSUE, BodyKind.TOOL)


@dataclass(frozen=True, slots=True, eq=False)
class WorldBody:
    """A part of the world, with its surface in its own frame."""

    name: str
    kind: BodyKind
    mesh: SurfaceMesh


class RequestOutcome(StrEnum):
    """Outcome of a request to the simulation."""

    WAITING = "requested"
    DONE = "done"
    REFUSED = "refused"
    UNANSWERED = "no answer"


@dataclass(frozen=True, slots=True)
class WorldRequest:
    """The last request, ``text``, at the user's ``stamp_ns``; ``reason`` of a refused one."""

    text: str
    body: str
    stamp_ns: int
    outcome: RequestOutcome = RequestOutcome.WAITING
    reason: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class WorldMoment:
    """The world as last received: ``world_from_body`` of each body, at ``stamp_ns``.

    ``stamp_ns`` is None before the first poses; a body whose pose is invalid has none.
    ``is_connected``: a simulation receives requests.
    """

    bodies: tuple[WorldBody, ...] = ()
    poses: Mapping[str, Transform] = field(default_factory=dict)
    stamp_ns: int | None = None
    request: WorldRequest | None = None
    is_connected: bool = False


class WorldOwner(Protocol):
    """Takes requests to the simulation, which owns the frames of its bodies."""

    def is_connected(self) -> bool:
        """True if a simulation receives them."""

    def move(self, poses: Iterable[Transform], stamp: Stamp) -> None:
        """Request ``world_from_body`` of some bodies."""

    def add(self, mesh: SurfaceMesh, world_from_body: Transform, stamp: Stamp) -> None:
        """Request a fixed body."""

    def remove(self, name: str, stamp: Stamp) -> None:
        """Request the end of a body."""


class SimulatedWorld:
    """State of a simulated world as received, and requests to it. Thread-safe.

    ``frame`` is the name of the world's frame, ``tracker`` the tracked frame that coincides with
    it. The stamp of a request is the time of ``clock_ns``, the host's, at which it is made. One
    that cannot be sent raises `InputError`.
    """

    def __init__(self, frame: str, tracker: str, clock_ns: Callable[[], int]) -> None:
        self.frame, self.tracker = frame, tracker
        self.clock_ns = clock_ns
        self.version = 0
        """Changes when something was received or requested."""
        self._lock = threading.Lock()
        self._owner: WorldOwner | None = None
        self._bodies: tuple[WorldBody, ...] = ()
        self._places: Mapping[str, Place] = {}
        self._stamp_ns: int | None = None
        self._request: WorldRequest | None = None
        self._target: Transform | None = None
        self._is_there: Callable[[], bool] = lambda: False

    def connect(self, owner: WorldOwner) -> None:
        """Send requests to ``owner`` from now on."""
        self._owner = owner

    def set_bodies(self, bodies: Sequence[WorldBody]) -> None:
        """Use these bodies from now on."""
        with self._lock:
            self._bodies = tuple(bodies)
            self.version += 1
            self._answer()

    def set_places(self, places: Mapping[str, Place], stamp_ns: int) -> None:
        """Use these places of all bodies at ``stamp_ns`` from now on."""
        with self._lock:
            self._places, self._stamp_ns = places, stamp_ns
            self.version += 1
            self._answer()

    def refused(self, reason: str) -> None:
        """Note that the simulation has refused a request, also one of another program."""
        with self._lock:
            request = self._request
            if request is None or self.clock_ns() - request.stamp_ns > ANSWER_NS:
                return
            if repr(request.body) in reason or reason.startswith("request:"):
                self._end(RequestOutcome.REFUSED, reason)

    def moment(self) -> WorldMoment:
        """The present."""
        with self._lock:
            request = self._request
            if (
                request is not None
                and request.outcome is RequestOutcome.WAITING
                and self.clock_ns() - request.stamp_ns > ANSWER_NS
            ):
                self._end(RequestOutcome.UNANSWERED)
            bodies, places, stamp_ns = self._bodies, self._places, self._stamp_ns
            request = self._request
        poses = {name: pose for name in places if (pose := self._pose(name, places)) is not None}
        is_connected = self._owner is not None and self._owner.is_connected()
        return WorldMoment(bodies, poses, stamp_ns, request, is_connected)

    def move(self, name: str, shift_mm: FloatArray, turn: FloatArray) -> None:
        """Request a body ``shift_mm`` (3,) further, turned about its origin by ``turn`` (3, 3).

        Both are in the axes of the world. A body whose last move has no answer yet is moved from
        the place of that request.
        """
        with self._lock:
            before = self._target if self._is_waiting_for(name) else None
            before = before or self._pose(name, self._places)
        if before is None:
            raise InputError(f"body {name!r}: its place is not known; expected one of the world")
        place_mm = before.translation_mm + shift_mm
        self.place(Transform(self.frame, name, turn @ before.rotation, place_mm))

    def place(self, world_from_body: Transform) -> None:
        """Request a body at a pose."""
        owner, name = self._connected(), world_from_body.source
        before = self._pose(name, self._places)
        stamp_ns = self._begin(
            f"move {name} to {place_text(world_from_body)}",
            name,
            lambda: self._is_at(world_from_body, before),
            world_from_body,
        )
        owner.move([world_from_body], Stamp(stamp_ns))

    def add(self, mesh: SurfaceMesh, world_from_body: Transform) -> None:
        """Request a fixed body with the surface ``mesh``, in the body's frame."""
        owner, name = self._connected(), world_from_body.source
        text = f"add {name} at {place_text(world_from_body)}"
        stamp_ns = self._begin(text, name, lambda: self._has(name) and name in self._places)
        owner.add(mesh, world_from_body, Stamp(stamp_ns))

    def remove(self, name: str) -> None:
        """Request the end of a body that a user has added."""
        owner = self._connected()
        kind = next((each.kind for each in self._bodies if each.name == name), None)
        if kind is not BodyKind.ADDED:
            raise InputError(f"body {name!r}: {kind or 'not known'}; expected an added body")
        stamp_ns = self._begin(f"remove {name}", name, lambda: not self._has(name))
        owner.remove(name, Stamp(stamp_ns))

    def _connected(self) -> WorldOwner:
        if self._owner is None or not self._owner.is_connected():
            raise InputError(
                "simulated world: no simulation receives requests; expected a running "
                "'marginguard simulate'"
            )
        return self._owner

    def _begin(
        self,
        text: str,
        body: str,
        is_there: Callable[[], bool],
        target: Transform | None = None,
    ) -> int:
        """Wait for a request's effect; its stamp."""
        with self._lock:
            stamp_ns = self.clock_ns()
            if self._request is not None:  # each edit of a body needs a later stamp
                stamp_ns = max(stamp_ns, self._request.stamp_ns + 1)
            self._request = WorldRequest(text, body, stamp_ns)
            self._is_there, self._target = is_there, target
            self.version += 1
            return stamp_ns

    def _answer(self) -> None:
        waits = self._request is not None and self._request.outcome in (
            RequestOutcome.WAITING,
            RequestOutcome.UNANSWERED,
        )
        if waits and self._is_there():
            self._end(RequestOutcome.DONE)

    def _end(self, outcome: RequestOutcome, reason: str = "") -> None:
        if self._request is not None:
            self._request = replace(self._request, outcome=outcome, reason=reason)
            self.version += 1

    def _is_waiting_for(self, name: str) -> bool:
        request = self._request
        return (
            request is not None
            and request.body == name
            and request.outcome is RequestOutcome.WAITING
        )

    def _has(self, name: str) -> bool:
        return any(each.name == name for each in self._bodies)

    def _is_at(self, target: Transform, before: Transform | None) -> bool:
        """True if a body is at ``target``; a free one may have fallen from there meanwhile."""
        pose = self._pose(target.source, self._places)
        if pose is None:
            return False
        x, y, z = (pose.translation_mm - target.translation_mm).tolist()
        if target.source in [each.name for each in self._bodies if each.kind is BodyKind.FREE]:
            has_moved = before is None or pose.distance_mm_to(before) > _NEAR_MM
            return math.hypot(x, y) < _NEAR_MM and (abs(z) < _NEAR_MM or (z < 0.0 and has_moved))
        turned = float(np.abs(pose.rotation - target.rotation).max())
        return math.hypot(x, y, z) < _SAME_MM and turned < _SAME

    def _pose(self, name: str, places: Mapping[str, Place]) -> Transform | None:
        place = places.get(name)
        if place is None:
            return None
        try:
            return Transform.from_quaternion(place[3:], place[:3], target=self.frame, source=name)
        except MarginGuardError:
            return None


def place_text(pose: Transform) -> str:
    """Position of ``pose`` for a person."""
    return ", ".join(f"{0.0 + round(each, 1):.1f}" for each in pose.translation_mm) + " mm"
