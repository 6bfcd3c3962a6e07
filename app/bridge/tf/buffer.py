"""A tree of frames over time: what tf2's buffer answers, without a node and without a clock.

Stamps are integer nanoseconds on the clock of the senders; poses are in mm. One thread may insert
while others look up.
"""

import math
import threading
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from app.bridge.tf.errors import (
    TfConnectivityError,
    TfError,
    TfExtrapolationError,
    TfInvalidError,
    TfLookupError,
)
from app.bridge.tf.history import EdgeHistory
from app.bridge.tf.pose import IDENTITY, Pose, compose, inverse, matrices
from app.geometry import NS_PER_S, FloatArray, Transform, check_frame

_UNIT_TOLERANCE = 1e-3
"""How far from 1 a quaternion's norm may be: as `app.geometry.Transform` has it."""


@dataclass(frozen=True, slots=True, eq=False)
class Lookup:
    """``transform`` at ``stamp_ns``; None for a way over static edges alone, which has no time."""

    transform: Transform
    stamp_ns: int | None


@dataclass(frozen=True, slots=True, eq=False)
class PoseSet:
    """``root_from_frame`` of many frames at one stamp: ``matrices`` (n, 4, 4) in mm, in order."""

    root: str
    frames: tuple[str, ...]
    matrices: FloatArray
    stamp_ns: int | None


class TransformBuffer:
    """Holds the last ``keep_ns`` of every edge, and answers for any two frames of one tree.

    A frame has one parent. When another one claims it, its past under the first is forgotten
    (`reparented` counts that). ``most_frames`` and ``most_samples`` bound the memory that a
    network can make us use: beyond the first a new frame is refused.
    """

    def __init__(
        self, *, keep_ns: int = 10 * NS_PER_S, most_frames: int = 1_000, most_samples: int = 10_000
    ) -> None:
        for name, value in (("keep_ns", keep_ns), ("most_samples", most_samples)):
            if value <= 0:
                raise TfInvalidError(f"{name} {value} of the buffer is not more than 0")
        self._keep_ns = keep_ns
        self._most_frames = most_frames
        self._most_samples = most_samples
        self._edges: dict[str, EdgeHistory] = {}
        self._frames: set[str] = set()
        self._changed = threading.Condition()
        self._now_ns: int | None = None
        self.reparented = 0
        self.jumps = 0

    def insert(
        self, parent: str, child: str, stamp_ns: int, pose: Pose, *, static: bool = False
    ) -> bool:
        """Take ``parent_from_child`` in; False for a repetition, or one too old to be kept.

        Raises `TfInvalidError` for what is no pose, `TfConnectivityError` for an edge that would
        close a loop. Nothing is changed then.
        """
        pose = _checked(parent, child, pose)
        with self._changed:
            history = self._edges.get(child)
            if history is None or history.parent != parent or history.static != static:
                history = self._new_edge(parent, child, static=static)
            taken = history.insert(stamp_ns, pose)
            self._changed.notify_all()
        return taken

    def set_now(self, now_ns: int) -> bool:
        """Say what time it is on the senders' clock (``/clock``); True when it has jumped back.

        All but the static edges is forgotten then: it belongs to another run of time.
        """
        with self._changed:
            jumped = self._now_ns is not None and now_ns < self._now_ns
            self._now_ns = now_ns
            if jumped:
                self.jumps += 1
                self._edges = {child: edge for child, edge in self._edges.items() if edge.static}
            return jumped

    def clear(self) -> None:
        """Forget everything, static edges too."""
        with self._changed:
            self._edges.clear()
            self._frames.clear()

    @property
    def frames(self) -> frozenset[str]:
        """Every frame that was named as a parent or a child."""
        with self._changed:
            return frozenset(self._frames)

    @property
    def restarts(self) -> int:
        """How often the stamps of an edge have jumped back."""
        with self._changed:
            return sum(edge.restarts for edge in self._edges.values())

    def parent(self, child: str) -> str | None:
        """The parent of a frame, None for a root or an unknown frame."""
        with self._changed:
            edge = self._edges.get(child)
            return edge.parent if edge is not None else None

    def lookup(self, target: str, source: str, stamp_ns: int | None = None) -> Lookup:
        """``target_from_source`` at a time; None: at the latest time that the whole way has.

        Raises `TfLookupError`, `TfConnectivityError` or `TfExtrapolationError`.
        """
        with self._changed:
            up, down = self._way(target, source)
            if stamp_ns is None:
                stamp_ns = self._latest_ns((*up, *down))
            target_from_top = inverse(self._along(up, stamp_ns))
            pose = compose(target_from_top, self._along(down, stamp_ns))
        transform = Transform.from_quaternion(pose[3:], pose[:3], target=target, source=source)
        return Lookup(transform, stamp_ns)

    def poses(self, root: str, frames: Sequence[str], stamp_ns: int | None = None) -> PoseSet:
        """``root_from_frame`` of all ``frames`` at one time, common to all; errors as `lookup`."""
        with self._changed:
            wanted: set[str] = set()
            for frame in frames:
                up, down = self._way(root, frame)
                wanted.update(up, down)
            if stamp_ns is None:
                stamp_ns = self._latest_ns(wanted)
            known: dict[str, Pose] = {}
            tops = [self._in_top(frame, wanted, stamp_ns, known) for frame in frames]
            root_from_top = inverse(self._in_top(root, wanted, stamp_ns, known))
        values = [compose(root_from_top, pose) for pose in tops]
        return PoseSet(root, tuple(frames), matrices(values), stamp_ns)

    def latest_common_ns(self, target: str, source: str) -> int | None:
        """The latest time that every edge of the way has; None when all of them are static."""
        with self._changed:
            up, down = self._way(target, source)
            return self._latest_ns((*up, *down))

    def age_ns(self, target: str, source: str, now_ns: int) -> int:
        """How old the oldest of the newest samples on the way is; 0 when all are static.

        A moving parent does not hide a stale child. Negative: a sample from the future is the
        oldest there is.
        """
        latest_ns = self.latest_common_ns(target, source)
        return 0 if latest_ns is None else now_ns - latest_ns

    def wait(
        self, target: str, source: str, stamp_ns: int | None = None, *, timeout_s: float
    ) -> Lookup:
        """As `lookup`, but wait until it can be answered; raises its last error when in vain."""
        found: list[Lookup] = []
        last: list[TfError] = []

        def answered() -> bool:
            try:
                found.append(self.lookup(target, source, stamp_ns))
            except TfError as error:
                last[:] = [error]
            return bool(found)

        with self._changed:
            if self._changed.wait_for(answered, timeout_s):
                return found[0]
        raise last[0]

    def _new_edge(self, parent: str, child: str, *, static: bool) -> EdgeHistory:
        new = {parent, child} - self._frames
        for name in new:
            check_frame(name)
        if len(self._frames) + len(new) > self._most_frames:
            raise TfInvalidError(
                f"{parent} -> {child} is frame number {self._most_frames + 1}: "
                f"{self._most_frames} frames allowed"
            )
        above = [parent]
        while above[-1] in self._edges:
            above.append(self._edges[above[-1]].parent)
            if above[-1] == child:
                loop = " -> ".join((child, *reversed(above[:-1]), child))
                raise TfConnectivityError(f"{parent} -> {child} would close the loop {loop}")
        if child in self._edges:
            self.reparented += 1
        history = EdgeHistory(parent, static=static, keep_ns=self._keep_ns, most=self._most_samples)
        self._edges[child] = history
        self._frames |= new
        return history

    def _above(self, frame: str) -> list[str]:
        """``frame`` and all above it, up to the root."""
        if frame not in self._frames:
            raise TfLookupError(f"frame {frame!r} is not known: {_some(self._frames)}")
        chain = [frame]
        while chain[-1] in self._edges:
            chain.append(self._edges[chain[-1]].parent)
        return chain

    def _way(self, target: str, source: str) -> tuple[tuple[str, ...], tuple[str, ...]]:
        """The children of the edges from each frame up to the nearest common ancestor."""
        of_target, of_source = self._above(target), self._above(source)
        if of_target[-1] != of_source[-1]:
            raise TfConnectivityError(
                f"there is no way between {target!r} (below {of_target[-1]!r}) and "
                f"{source!r} (below {of_source[-1]!r})"
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
        edges = (self._edges[child] for child in children)
        return min((edge.newest_ns for edge in edges if not edge.static), default=None)

    def _along(self, children: Sequence[str], stamp_ns: int | None) -> Pose:
        """``top_from_first`` over the edges above each of ``children``, the lowest first."""
        pose = IDENTITY
        for child in children:
            pose = compose(self._edge_at(child, stamp_ns), pose)
        return pose

    def _in_top(
        self, frame: str, wanted: set[str], stamp_ns: int | None, known: dict[str, Pose]
    ) -> Pose:
        """``top_from_frame`` over the edges above the ``wanted`` children.

        The top is where they end; ``known`` keeps what several frames have in common.
        """
        chain = []
        while frame in wanted and frame not in known:
            chain.append(frame)
            frame = self._edges[frame].parent
        pose = known.get(frame, IDENTITY)
        for child in reversed(chain):
            pose = compose(pose, self._edge_at(child, stamp_ns))
            known[child] = pose
        return pose

    def _edge_at(self, child: str, stamp_ns: int | None) -> Pose:
        edge = self._edges[child]
        # Without a stamp there are static edges alone on the way, which hold at any time.
        pose = edge.at(0 if stamp_ns is None else stamp_ns)
        if pose is None:
            raise TfExtrapolationError(
                f"{edge.parent} -> {child} is known from {edge.oldest_ns} to {edge.newest_ns} ns: "
                f"asked for {stamp_ns} ns"
            )
        return pose


def _checked(parent: str, child: str, pose: Pose) -> Pose:
    """``pose`` with a quaternion of length 1."""
    if parent == child:
        raise TfInvalidError(f"frame {child!r} is given as its own parent")
    x, y, z, p, q, r, s = pose
    # What is not finite has a sum that is not finite either.
    if not math.isfinite(x + y + z + p + q + r + s):
        raise TfInvalidError(f"{parent} -> {child} is not finite: {list(pose)}")
    norm = math.sqrt(p * p + q * q + r * r + s * s)
    if not abs(norm - 1.0) <= _UNIT_TOLERANCE:
        raise TfInvalidError(
            f"quaternion of {parent} -> {child} has norm {norm:.6g}: "
            f"1 within {_UNIT_TOLERANCE} wanted"
        )
    return (x, y, z, p / norm, q / norm, r / norm, s / norm)


def _some(frames: set[str]) -> str:
    if not frames:
        return "none is known yet"
    names = sorted(frames)
    return f"known are {', '.join(names[:8])}{' and others' if len(names) > 8 else ''}"
