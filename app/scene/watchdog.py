"""How old is what the scene shows of each transform; the present is handed in, never read."""

from dataclasses import dataclass
from enum import Enum

from app.geometry import TrackedTransform, TrackingStatus, join_transform_name
from app.scene.errors import SceneError


class Freshness(Enum):
    """What can be said of a transform; the value is the word to show."""

    VALID = "valid"
    STALE = "stale"
    """Its last good sample is older than allowed, or from the future."""
    MISSING = "missing"
    """It was never seen, or the tracker said at last that it does not see it."""

    @property
    def color(self) -> tuple[float, float, float]:
        """Red, green and blue from 0 to 1, for a lamp: grey when it is not to be trusted."""
        return _COLORS[self]


_COLORS = {
    Freshness.VALID: (0.0, 1.0, 0.0),
    Freshness.STALE: (0.5, 0.5, 0.5),
    Freshness.MISSING: (0.5, 0.5, 0.5),
}


@dataclass(frozen=True, slots=True)
class TransformHealth:
    """One transform at one moment: ``name`` as ``CauteryToTracker``.

    ``age_ns`` is that of its last good sample, None when there was none.
    """

    name: str
    freshness: Freshness
    age_ns: int | None

    @property
    def text(self) -> str:
        """For a lamp: ``CauteryToTracker: stale, 0.4 s``."""
        age = "never seen" if self.age_ns is None else f"{self.age_ns / 1e9:.1f} s"
        return f"{self.name}: {self.freshness.value}, {age}"


class TransformWatchdog:
    """Knows for every transform when its last good sample was acquired.

    By the source's own stamps and per edge: a parent that moves changes where a child is drawn,
    and says nothing of the child (watchdogs that listen to a node's events take it for news).
    ``stale_after_ns`` is above 0. All times are on one clock, that of the samples.
    """

    def __init__(self, stale_after_ns: int) -> None:
        if stale_after_ns <= 0:
            raise SceneError(f"stale_after_ns {stale_after_ns} of a watchdog: above 0 wanted")
        self.stale_after_ns = stale_after_ns
        self._good_ns: dict[tuple[str, str], int | None] = {}
        self._lost: set[tuple[str, str]] = set()

    def expect(self, target: str, source: str) -> None:
        """Watch this edge from now on: it is missing until it is seen."""
        self._good_ns.setdefault((target, source), None)

    def saw(self, sample: TrackedTransform) -> None:
        """Take note of a sample, good or lost; one older than the last good one is no news."""
        edge = (sample.target, sample.source)
        last_ns = self._good_ns.setdefault(edge, None)
        if last_ns is not None and sample.stamp.ns < last_ns:
            return
        if sample.status is TrackingStatus.OK:
            self._good_ns[edge] = sample.stamp.ns
            self._lost.discard(edge)
        else:
            self._lost.add(edge)

    def restart(self) -> None:
        """Forget all samples, as after a seek; the edges stay watched."""
        self._good_ns = dict.fromkeys(self._good_ns)
        self._lost.clear()

    def is_fresh(self, stamp_ns: int | None, now_ns: int) -> bool:
        """Whether data of that stamp may be shown at ``now_ns``; none at all and the future not."""
        return stamp_ns is not None and 0 <= now_ns - stamp_ns <= self.stale_after_ns

    def check(self, now_ns: int) -> tuple[TransformHealth, ...]:
        """Every watched transform at ``now_ns``, in the order in which they were first named."""
        return tuple(self._health(edge, now_ns) for edge in self._good_ns)

    def _health(self, edge: tuple[str, str], now_ns: int) -> TransformHealth:
        target, source = edge
        last_ns = self._good_ns[edge]
        age_ns = None if last_ns is None else now_ns - last_ns
        if age_ns is None or edge in self._lost:
            freshness = Freshness.MISSING
        elif self.is_fresh(last_ns, now_ns):
            freshness = Freshness.VALID
        else:
            freshness = Freshness.STALE
        return TransformHealth(join_transform_name(source, target), freshness, age_ns)
