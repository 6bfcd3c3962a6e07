"""How old is what the scene shows of each transform; the present is handed in, never read."""

from dataclasses import dataclass

from app.geometry import (
    NS_PER_S,
    Freshness,
    FreshnessLimits,
    TrackedTransform,
    TrackingStatus,
    freshness_of,
    join_transform_name,
)
from app.scene.errors import SceneError


@dataclass(frozen=True, slots=True)
class TransformHealth:
    """One transform at one moment: ``name`` as ``CauteryToTracker``.

    ``freshness`` is VALID, STALE (too old, or from the future) or MISSING (never seen, or the
    newest sample is a lost one). ``age_ns`` is that of its last good sample, None without one.
    """

    name: str
    freshness: Freshness
    age_ns: int | None

    @property
    def text(self) -> str:
        """For a lamp: ``CauteryToTracker: stale, 0.4 s``."""
        if self.age_ns is None:
            return f"{self.name}: {self.freshness.value}, never seen"
        ahead = " ahead" if self.age_ns < 0 else ""
        return f"{self.name}: {self.freshness.value}, {abs(self.age_ns) / NS_PER_S:.1f} s{ahead}"


@dataclass(slots=True)
class _Edge:
    """Stamps in ns of the newest sample, which may be a lost one, and of the last good one."""

    seen_ns: int | None = None
    good_ns: int | None = None
    is_lost: bool = False


class TransformWatchdog:
    """Knows for every transform when its last good sample was acquired.

    By the source's own stamps and per edge: a parent that moves changes where a child is drawn,
    and says nothing of the child (watchdogs that listen to a node's events take it for news).
    ``stale_after_ns`` is above 0. All times are on one clock, that of the samples.
    """

    def __init__(self, stale_after_ns: int) -> None:
        self.set_stale_after(stale_after_ns)
        self._edges: dict[tuple[str, str], _Edge] = {}

    def set_stale_after(self, stale_after_ns: int) -> None:
        """Use another limit from now on. Raises `SceneError` for one that is not above 0."""
        if stale_after_ns <= 0:
            raise SceneError(f"watchdog: stale_after_ns is {stale_after_ns}; expected more than 0")
        self.stale_after_ns = stale_after_ns
        self._limits = FreshnessLimits(stale_after_ns)

    def expect(self, target: str, source: str) -> None:
        """Watch this edge from now on: it is missing until it is seen."""
        self._edges.setdefault((target, source), _Edge())

    def saw(self, sample: TrackedTransform) -> None:
        """Take note of a sample, good or lost.

        One that is older than the newest is no news, and of two of one moment the lost one counts.
        Older by more than ``stale_after_ns`` is news again: then a clock was put back, or a stamp
        from the future was taken for the newest.
        """
        edge = self._edges.setdefault((sample.target, sample.source), _Edge())
        ns, is_good = sample.stamp.ns, sample.status is TrackingStatus.OK
        if edge.seen_ns is not None:
            late_ns = edge.seen_ns - ns
            if 0 < late_ns <= self.stale_after_ns or (late_ns == 0 and is_good):
                return
        edge.seen_ns, edge.is_lost = ns, not is_good
        if is_good:
            edge.good_ns = ns

    def restart(self) -> None:
        """Forget all samples, as after a seek; the edges stay watched."""
        self._edges = {names: _Edge() for names in self._edges}

    def is_fresh(self, stamp_ns: int | None, now_ns: int) -> bool:
        """Whether data of that stamp may be shown at ``now_ns``; none at all and the future not."""
        return freshness_of(stamp_ns, now_ns, self._limits) is Freshness.VALID

    def check(self, now_ns: int) -> tuple[TransformHealth, ...]:
        """Every watched transform at ``now_ns``, in the order in which they were first named."""
        return tuple(self._health(*names, edge, now_ns) for names, edge in self._edges.items())

    def _health(self, target: str, source: str, edge: _Edge, now_ns: int) -> TransformHealth:
        age_ns = None if edge.good_ns is None else now_ns - edge.good_ns
        freshness = freshness_of(None if edge.is_lost else edge.good_ns, now_ns, self._limits)
        if freshness is Freshness.FUTURE:
            # Lamps have no fourth colour; the text says "ahead" beside the age.
            freshness = Freshness.STALE
        return TransformHealth(join_transform_name(source, target), freshness, age_ns)
