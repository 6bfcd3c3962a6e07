"""Detect frames whose pose several senders measure."""

from collections.abc import Collection, Iterator
from typing import NamedTuple

from app.geometry import Edge, shortest_path
from app.session.sender_trail import (
    HANDOVER_NS,
    MAX_SENDERS,
    Present,
    Sample,
    Sender,
    SenderTrail,
    has_ended,
)
from app.session.sequence_trail import SequenceTrail

MAX_FRAMES = 256
"""Frames and edges that are followed; the session uses no more edges either."""


class SenderConflict(NamedTuple):
    """Several ``senders`` of a frame: none is listed where the middleware identifies none.

    ``edge`` is the latest measured edge (parent, child) of that frame. With ``loop`` it connects
    two frames that other senders connect already.
    """

    edge: Edge
    senders: frozenset[Sender]
    loop: bool = False


class _Loop(NamedTuple):
    sender: Sender
    others: frozenset[Sender]
    edges: frozenset[Edge]


class FrameSenders:
    """Follows the senders of each child frame on one topic.

    In a tree a frame has one parent, so the samples of a frame have one sender, whatever the parent
    is: an edge from another parent and another sender is a conflict as well. One sender may measure
    a frame from several parents. A new edge that closes a loop with edges of other senders is
    refused, because it would replace measured edges on the path between two frames. Of the frames
    that are not children of ``named`` edges the first `MAX_FRAMES` are followed.

    Times are of a monotonic clock in ns.
    """

    def __init__(self, named: Collection[Edge] = ()) -> None:
        self._trails = {child: SenderTrail() for _, child in named}
        self._sequences = {child: SequenceTrail() for _, child in named}
        self._limit = len(self._trails) + MAX_FRAMES
        self._edges: dict[Edge, Sender] = {}
        self._connected: set[str] = set()
        self._last_edge: dict[str, Edge] = {}
        self._heard: dict[Sender, int] = {}
        self._loops: dict[Edge, _Loop] = {}

    def observe(
        self, edge: Edge, sender: Sender, sample: Sample, now_ns: int, fresh_ns: int = 0
    ) -> bool:
        """Process a sample of an identified sender; False if it must not be used.

        ``fresh_ns`` as in `SenderTrail`.
        """
        child = edge[1]
        if child not in self._trails:
            if len(self._trails) >= self._limit:
                return True
            self._trails[child] = SenderTrail()
        self._last_edge[child] = edge
        self._hear(sender, now_ns)
        if edge in self._loops or (
            edge not in self._edges and self._closes_loop(edge, sender, now_ns)
        ):
            return False
        if not self._trails[child].observe(sender, _of_edge(sample, edge), now_ns, fresh_ns):
            return False
        is_copy = self._trails[child].owner != sender
        if not is_copy and (edge in self._edges or len(self._edges) < self._limit):
            self._edges[edge] = sender
            self._connected.update(edge)
        return True

    def observe_sequence(self, edge: Edge, sequence: int, sample: Sample, now_ns: int) -> None:
        """Process a sample whose sender is not identified, from the message ``sequence``."""
        child = edge[1]
        if child in self._sequences or len(self._sequences) < self._limit:
            self._last_edge[child] = edge
            trail = self._sequences.setdefault(child, SequenceTrail())
            trail.observe(sequence, _of_edge(sample, edge), now_ns)

    def has_conflict(self, child: str) -> bool:
        """True if samples of the frame ``child`` are in a conflict, which may have ended."""
        trail, sequences = self._trails.get(child), self._sequences.get(child)
        return (
            (trail is not None and bool(trail.conflict))
            or (sequences is not None and sequences.conflict)
            or any(edge[1] == child for edge in self._loops)
        )

    def conflicts(
        self, used: Collection[Edge], frames: Collection[str], now_ns: int, is_present: Present
    ) -> Iterator[SenderConflict]:
        """Conflicts of the edges ``used`` and of the child ``frames`` that have not ended."""
        children = {*frames, *(child for _, child in used)}
        for child, trail in self._trails.items():
            senders = trail.check(now_ns, is_present)
            if senders and child in children:
                yield SenderConflict(self._last_edge[child], senders)
        for child, sequences in self._sequences.items():
            if sequences.check(now_ns) and child in children:
                yield SenderConflict(self._last_edge[child], frozenset())
        for edge, loop in list(self._loops.items()):
            if self._has_ended(loop, now_ns, is_present):
                del self._loops[edge]
            elif not loop.edges.isdisjoint(used):
                yield SenderConflict(edge, frozenset({loop.sender, *loop.others}), loop=True)

    def _hear(self, sender: Sender, now_ns: int) -> None:
        self._heard.pop(sender, None)
        self._heard[sender] = now_ns
        if len(self._heard) > MAX_SENDERS * 4:
            del self._heard[next(iter(self._heard))]

    def _closes_loop(self, edge: Edge, sender: Sender, now_ns: int) -> bool:
        if len(self._edges) >= self._limit or not all(map(self._connected.__contains__, edge)):
            return False  # ignored, or with an end that no other edge has
        active = {
            other: owner
            for other, owner in self._edges.items()
            if owner == sender or now_ns - self._heard.get(owner, 0) < HANDOVER_NS
        }
        path = shortest_path(active, *edge) or ()
        others = frozenset(active[each] for each in path) - {sender}
        if others and len(self._loops) < MAX_FRAMES:
            self._loops[edge] = _Loop(sender, others, frozenset(path))
        return bool(others)

    def _has_ended(self, loop: _Loop, now_ns: int, is_present: Present) -> bool:
        def ended(sender: Sender) -> bool:
            return has_ended(sender, self._heard.get(sender), now_ns, is_present)

        return ended(loop.sender) or any(map(ended, loop.others))


def _of_edge(sample: Sample, edge: Edge) -> Sample:
    """``sample`` with its edge as a part of its content: an owner may send several parents."""
    return Sample(sample.ns, (edge, sample.content))
