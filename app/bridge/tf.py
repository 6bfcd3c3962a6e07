"""Transform buffer like that of tf2, without a node and without a clock.

Stamps are integer nanoseconds on the clock of the publishers; poses are in mm. Thread-safe.
"""

import math
import threading
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass

from app.bridge.ros_errors import (
    TfConnectivityError,
    TfExtrapolationError,
    TfInvalidError,
    TfLookupError,
)
from app.bridge.tf_poses import IDENTITY, Pose, compose, interpolate, inverse
from app.geometry import (
    NS_PER_S,
    StampHistory,
    Transform,
    chain_to_root,
    check_frame,
)

DISORDER_NS = NS_PER_S
"""A sample that is older than the newest by more than this indicates a restarted source."""

_UNIT_TOLERANCE = 1e-3
"""Allowed deviation of a quaternion's norm from 1, as in `app.geometry.Transform`."""


@dataclass(frozen=True, slots=True, eq=False)
class Lookup:
    """``transform`` at ``stamp_ns``, which is None if all edges of the path are static."""

    transform: Transform
    stamp_ns: int | None


@dataclass(slots=True)
class _Edge:
    """``parent_from_child`` by its ``history``; without one, of a static edge, by ``pose``."""

    parent: str
    history: StampHistory[Pose] | None
    pose: Pose = IDENTITY


class TransformBuffer:
    """Keeps the last ``keep_ns`` of every edge and looks up transforms between any two frames.

    A frame has one parent. A new parent discards the history under the old one. So does a jump
    back by more than `DISORDER_NS`. Of two samples with the same stamp the first is kept, as in
    tf2, so that the result of a lookup does not change.
    ``max_frames`` (in total) and ``max_samples`` (per edge) bound the memory that network input can
    occupy; frames beyond the limit are refused.
    """

    def __init__(
        self, *, keep_ns: int = 10 * NS_PER_S, max_frames: int = 1_000, max_samples: int = 10_000
    ) -> None:
        for name, value in (("keep_ns", keep_ns), ("max_samples", max_samples)):
            if value <= 0:
                raise TfInvalidError(f"{name} of the buffer is {value}; expected more than 0")
        self._keep_ns = keep_ns
        self._max_frames = max_frames
        self._max_samples = max_samples
        self._edges: dict[str, _Edge] = {}
        self._frames: set[str] = set()
        self._lock = threading.RLock()
        self._now_ns: int | None = None

    def insert(
        self, parent: str, child: str, stamp_ns: int, pose: Pose, *, static: bool = False
    ) -> bool:
        """Add a sample of ``parent_from_child``; False if it is a repetition or too old.

        Raises `TfInvalidError` for an invalid pose and `TfConnectivityError` for an edge that would
        close a loop. The buffer is unchanged then.
        """
        pose = _normalized(parent, child, pose)
        with self._lock:
            edge = self._edges.get(child)
            if edge is None or edge.parent != parent or (edge.history is None) != static:
                edge = self._new_edge(parent, child, static=static)
            if edge.history is None:
                edge.pose = pose
            return edge.history is None or edge.history.insert(stamp_ns, pose)

    def set_now(self, now_ns: int) -> bool:
        """Set the time of the publishers' clock (``/clock``); True if it has jumped back.

        A jump back discards everything but the static edges, because it starts a new recording.
        """
        with self._lock:
            jumped = self._now_ns is not None and now_ns < self._now_ns
            self._now_ns = now_ns
            if jumped:
                edges = self._edges.items()
                self._edges = {child: edge for child, edge in edges if edge.history is None}
            return jumped

    def clear(self) -> None:
        """Discard all edges, including static ones."""
        with self._lock:
            self._edges.clear()
            self._frames.clear()

    @property
    def frames(self) -> frozenset[str]:
        """All frames that occur as a parent or a child."""
        with self._lock:
            return frozenset(self._frames)

    def parent(self, child: str) -> str | None:
        """Parent of a frame; None for a root or an unknown frame."""
        with self._lock:
            edge = self._edges.get(child)
            return edge.parent if edge is not None else None

    def lookup(self, target: str, source: str, stamp_ns: int | None = None) -> Lookup:
        """Look up ``target_from_source`` at ``stamp_ns``; None means the latest common time.

        Raises `TfLookupError`, `TfConnectivityError` or `TfExtrapolationError`.
        """
        with self._lock:
            up, down = self._path(target, source)
            if stamp_ns is None:
                stamp_ns = self._latest_ns((*up, *down))
            target_from_top = inverse(self._along(up, stamp_ns))
            pose = compose(target_from_top, self._along(down, stamp_ns))
        transform = Transform.from_quaternion(pose[3:], pose[:3], target=target, source=source)
        return Lookup(transform, stamp_ns)

    def attachments(self, frame: str, known: Collection[str]) -> frozenset[str]:
        """Frames of ``known`` that edges connect with ``frame``, without passing another of them.

        Raises `TfLookupError` for an unknown frame.
        """
        with self._lock:
            self._chain(frame)
            children: dict[str, list[str]] = {}
            for child, edge in self._edges.items():
                children.setdefault(edge.parent, []).append(child)
            found: set[str] = set()
            reached, waiting = {frame}, [frame]
            while waiting:
                at = waiting.pop()
                if at in known:
                    found.add(at)
                    continue
                parent = [self._edges[at].parent] if at in self._edges else []
                beyond = {*parent, *children.get(at, ())} - reached
                reached |= beyond
                waiting += beyond
        return frozenset(found)

    def latest_common_ns(self, target: str, source: str) -> int | None:
        """Latest time that every edge of the path has; None if all of them are static."""
        with self._lock:
            up, down = self._path(target, source)
            return self._latest_ns((*up, *down))

    def _new_edge(self, parent: str, child: str, *, static: bool) -> _Edge:
        new = {parent, child} - self._frames
        for name in new:
            check_frame(name)
        if len(self._frames) + len(new) > self._max_frames:
            raise TfInvalidError(
                f"{parent} -> {child} adds frame number {self._max_frames + 1}; "
                f"expected at most {self._max_frames} frames"
            )
        above = chain_to_root(parent, self.parent)
        if child in above:
            loop = " -> ".join((child, *reversed(above[: above.index(child)]), child))
            raise TfConnectivityError(f"{parent} -> {child} would close the loop {loop}")
        history: StampHistory[Pose] = StampHistory(
            keep_ns=self._keep_ns, restart_ns=DISORDER_NS, max_values=self._max_samples
        )
        edge = self._edges[child] = _Edge(parent, None if static else history)
        self._frames |= new
        return edge

    def _chain(self, frame: str) -> list[str]:
        """``frame`` and its ancestors, up to the root."""
        if frame not in self._frames:
            raise TfLookupError(f"frame {frame!r} is unknown; {_known(self._frames)}")
        return chain_to_root(frame, self.parent)

    def _path(self, target: str, source: str) -> tuple[tuple[str, ...], tuple[str, ...]]:
        """Children of the edges from ``target`` and ``source`` to their lowest common ancestor."""
        of_target, of_source = self._chain(target), self._chain(source)
        if of_target[-1] != of_source[-1]:
            raise TfConnectivityError(
                f"no path between {target!r} (root {of_target[-1]!r}) and "
                f"{source!r} (root {of_source[-1]!r})"
            )
        shared = 0
        while shared < min(len(of_target), len(of_source)) and (
            of_target[-1 - shared] == of_source[-1 - shared]
        ):
            shared += 1
        return (
            tuple(of_target[: len(of_target) - shared]),
            tuple(of_source[: len(of_source) - shared]),
        )

    def _latest_ns(self, children: Iterable[str]) -> int | None:
        histories = (self._edges[child].history for child in children)
        return min((each.newest_ns for each in histories if each is not None), default=None)

    def _along(self, children: Sequence[str], stamp_ns: int | None) -> Pose:
        """``top_from_first``, composed of the edges above ``children``, which are bottom-up."""
        pose = IDENTITY
        for child in children:
            pose = compose(self._edge_at(child, stamp_ns), pose)
        return pose

    def _edge_at(self, child: str, stamp_ns: int | None) -> Pose:
        edge, history = self._edges[child], self._edges[child].history
        if history is None:
            return edge.pose
        # Without a stamp all edges of the path are static.
        found = None if stamp_ns is None else history.around(stamp_ns)
        if found is None:
            raise TfExtrapolationError(
                f"{edge.parent} -> {child} at {stamp_ns} ns: outside the buffered range; "
                f"expected {history.oldest_ns} to {history.newest_ns} ns"
            )
        before, after, fraction = found
        return before if before is after else interpolate(before, after, fraction)


def _normalized(parent: str, child: str, pose: Pose) -> Pose:
    """``pose`` with a unit quaternion; raises `TfInvalidError`."""
    if parent == child:
        raise TfInvalidError(f"frame {child!r} is its own parent")
    x, y, z, p, q, r, s = pose
    # The sum is not finite if any number is not finite.
    if not math.isfinite(x + y + z + p + q + r + s):
        raise TfInvalidError(f"{parent} -> {child} is {list(pose)}; expected finite numbers")
    norm = math.sqrt(p * p + q * q + r * r + s * s)
    if not abs(norm - 1.0) <= _UNIT_TOLERANCE:
        raise TfInvalidError(
            f"quaternion of {parent} -> {child} has norm {norm:.6g}; "
            f"expected 1 within {_UNIT_TOLERANCE}"
        )
    return (x, y, z, p / norm, q / norm, r / norm, s / norm)


def _known(frames: set[str]) -> str:
    if not frames:
        return "the buffer is empty"
    names = sorted(frames)
    return f"known frames: {', '.join(names[:8])}{' and others' if len(names) > 8 else ''}"
