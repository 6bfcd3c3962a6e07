"""Frames whose pose several senders measure, found by the senders' identities and sequence numbers.

A sender is known by an identity that the middleware gives it. A restarted driver is another sender
than before, and it is not a second one, because the earlier one has stopped.
"""

from collections import OrderedDict, deque
from collections.abc import Callable, Collection, Hashable, Iterator
from typing import NamedTuple

from app.geometry import NS_PER_MS, NS_PER_S, Edge, shortest_path

HANDOVER_NS = 100 * NS_PER_MS
"""Silence of a sender after which another one may take over. No process restarts faster."""

SILENT_NS = 2 * NS_PER_S
"""Silence after which a sender that has left the graph has ended."""

LEASE_NS = 20 * NS_PER_S
"""Silence after which any sender has ended. The graph lists a killed process for that long."""

MAX_SAMPLES = 256
"""Samples that are remembered to recognise copies."""

MAX_SENDERS = 16
"""Senders that are remembered; beyond it the earliest is forgotten."""

MAX_UNMATCHED = 8
"""Samples of a refused sender that wait for their original."""

Sender = Hashable
Present = Callable[[Sender], bool]
"""True if the graph lists the sender."""


class Sample(NamedTuple):
    """A sample, known by its stamp in ns and its content."""

    ns: int
    content: Hashable


def has_ended(sender: Sender, heard_ns: int | None, now_ns: int, is_present: Present) -> bool:
    """True if ``sender``, last heard at ``heard_ns``, does not send any more."""
    if heard_ns is None:
        return True
    silent_ns = now_ns - heard_ns
    return silent_ns >= LEASE_NS or (silent_ns >= SILENT_NS and not is_present(sender))


class SenderTrail:
    """Assigns a stream to one sender, its owner, and detects others.

    A sample of another sender is refused while the owner is heard. If the owner sends afterwards,
    both send: a conflict. If the owner remains silent for `HANDOVER_NS`, the other one becomes the
    owner. That is a conflict too if an earlier owner returns, and if the silence was too short to
    be noticed: the owner's last sample is in use for ``fresh_ns``, and `HANDOVER_NS` later at most
    a step has found it stale.

    An exact copy of a remembered sample (same stamp, same content) is not counted: a relay that
    repeats samples adds no second source. A copy that arrives before its original is refused, and
    it is forgotten when the original arrives.

    A conflict lasts until all of its senders but one have ended (`SILENT_NS`, `LEASE_NS`). Times
    are of a monotonic clock in ns.
    """

    def __init__(self) -> None:
        self.owner: Sender | None = None
        self.conflict: frozenset[Sender] = frozenset()
        self._heard: OrderedDict[Sender, int] = OrderedDict()
        self._former: OrderedDict[Sender, None] = OrderedDict()
        self._recent: OrderedDict[Sample, None] = OrderedDict()
        self._unmatched: dict[Sender, dict[Sample, int]] = {}
        """Refused samples, and for how many samples of the owner each has waited."""

    def observe(self, sender: Sender, sample: Sample, now_ns: int, fresh_ns: int = 0) -> bool:
        """Process a sample that arrived at ``now_ns``; False if it must not be used."""
        if sender != self.owner and sample in self._recent:
            return True  # a copy, which the session drops
        if self.owner is None:
            self.owner = sender
        is_owner = sender == self.owner
        if not is_owner and (silent_ns := now_ns - self._heard[self.owner]) >= HANDOVER_NS:
            self._hand_over(sender, is_noticed=silent_ns - HANDOVER_NS >= fresh_ns)
            is_owner = True
        self._heard[sender] = now_ns
        self._heard.move_to_end(sender)
        if is_owner:
            self._match(sample)
            self._remember(self._recent, sample, MAX_SAMPLES)
        else:
            self._refuse(sender, sample)
        return is_owner

    def check(self, now_ns: int, is_present: Present) -> frozenset[Sender]:
        """Senders that are in conflict; empty if there is none, or if all but one have ended."""
        if self.conflict:
            active = [
                each for each in self.conflict if not self._has_ended(each, now_ns, is_present)
            ]
            if len(active) <= 1:
                self.owner = active[0] if active else None
                self.conflict = frozenset()
                self._former.clear()
                self._unmatched.clear()
        return self.conflict

    def _hand_over(self, sender: Sender, is_noticed: bool) -> None:
        if sender in self._former or not is_noticed:
            self._add_conflict(sender)
        self._remember(self._former, self.owner, MAX_SENDERS)
        self.owner = sender
        self._unmatched.clear()

    def _match(self, sample: Sample) -> None:
        """Compare the refused samples with one of the owner; those without original conflict."""
        for sender, waiting in list(self._unmatched.items()):
            waiting.pop(sample, None)
            # The original of a copy has its stamp: it would have come before a later one.
            if any(other.ns < sample.ns or seen >= 1 for other, seen in waiting.items()):
                self._add_conflict(sender)
                waiting.clear()
            self._unmatched[sender] = {other: seen + 1 for other, seen in waiting.items()}

    def _refuse(self, sender: Sender, sample: Sample) -> None:
        waiting = self._unmatched.setdefault(sender, {})
        waiting[sample] = 0
        if len(waiting) > MAX_UNMATCHED:
            del waiting[next(iter(waiting))]
        while len(self._unmatched) > MAX_SENDERS:
            del self._unmatched[next(iter(self._unmatched))]
        while len(self._heard) > MAX_SENDERS:
            oldest = next(each for each in self._heard if each != self.owner)
            del self._heard[oldest]

    def _add_conflict(self, sender: Sender) -> None:
        # A conflict keeps those of its senders that are remembered.
        known = [each for each in self.conflict if each in self._heard]
        self.conflict = frozenset({*known, sender, self.owner})

    def _has_ended(self, sender: Sender, now_ns: int, is_present: Present) -> bool:
        return has_ended(sender, self._heard.get(sender), now_ns, is_present)

    @staticmethod
    def _remember(memory: OrderedDict, key: Hashable, limit: int) -> None:  # type: ignore[type-arg]
        memory[key] = None
        memory.move_to_end(key)
        if len(memory) > limit:
            memory.popitem(last=False)


DROPS_WITHIN_NS = 5 * NS_PER_S
"""Two drops of the sequence number within this time mean two senders."""

ENDED_NS = 20 * NS_PER_S
"""Time without a drop after which a second sender has ended."""


MAX_SEQUENCE_SAMPLES = 256
"""Samples that are remembered to recognise copies."""


class SequenceTrail:
    """Counts the drops of the sequence numbers of one stream.

    Each sender numbers its messages upwards, and the middleware delivers those of one sender in
    order. A restarted sender begins anew: one drop. Two senders drop at each change from the one
    with the higher number to the other one. A copy of a remembered sample is not counted. Times
    are of a monotonic clock in ns.
    """

    def __init__(self) -> None:
        self._last: int | None = None
        self._drops_ns: deque[int] = deque(maxlen=2)
        self._conflict_ns: int | None = None
        self._recent: OrderedDict[Hashable, None] = OrderedDict()

    def observe(self, sequence: int, sample: Hashable, now_ns: int) -> None:
        """Process ``sample``, which arrived at ``now_ns`` in the message ``sequence``."""
        if sample in self._recent:
            return
        self._recent[sample] = None
        if len(self._recent) > MAX_SEQUENCE_SAMPLES:
            self._recent.popitem(last=False)
        if self._last is not None and sequence <= self._last:
            self._drops_ns.append(now_ns)
            if len(self._drops_ns) == 2 and now_ns - self._drops_ns[0] <= DROPS_WITHIN_NS:
                self._conflict_ns = now_ns
        self._last = sequence

    @property
    def conflict(self) -> bool:
        """True after a conflict, until `check` finds that it has ended."""
        return self._conflict_ns is not None

    def check(self, now_ns: int) -> bool:
        """True if there are two senders."""
        if self._conflict_ns is not None and now_ns - self._conflict_ns >= ENDED_NS:
            self._conflict_ns = None
            self._drops_ns.clear()
        return self._conflict_ns is not None


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
