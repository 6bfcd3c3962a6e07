"""Decide whether the samples of one stream (a frame, the joints) come from one sender.

A sender is known by an identity that the middleware gives it. A restarted driver is another sender
than before, and it is not a second one, because the earlier one has stopped.
"""

from collections import OrderedDict
from collections.abc import Callable, Hashable
from typing import NamedTuple

from app.geometry import NS_PER_MS, NS_PER_S

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
