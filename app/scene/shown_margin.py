"""The data that the scene shows as current: health of the transforms, and the margin.

The margin is UNKNOWN for data that are old, from the future or not finite. Reads no clock.
"""

from collections.abc import Iterable
from dataclasses import dataclass

from app.fixture import Constraint, FixtureDecision, MarginState, Proximity, Reason
from app.geometry import (
    NS_PER_S,
    Freshness,
    FreshnessLimits,
    TrackedTransform,
    TrackingStatus,
    freshness_of,
    join_transform_name,
)
from app.scene.offscreen import SceneError

_MAX_REASONS = 3


@dataclass(frozen=True, slots=True)
class TransformHealth:
    """Freshness of one transform at one time; ``name`` such as ``ToolToTracker``.

    ``freshness`` is VALID, STALE (too old, or from the future) or MISSING (never seen, or the
    newest sample is a lost one). ``age_ns`` is that of its last good sample, None without one.
    """

    name: str
    freshness: Freshness
    age_ns: int | None

    @property
    def text(self) -> str:
        """Text of an indicator: ``ToolToTracker: stale, 0.4 s``."""
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
    """Keeps the stamp of the last good sample of each measured edge.

    Stamps are those of the source, per edge. A watchdog that listens to a node's events takes a
    moving parent for a sample of its child; this one does not. All times are on the clock of the
    samples. Raises `SceneError` unless ``stale_after_ns`` is above 0.
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
        """Watch this edge; it is missing until its first sample."""
        self._edges.setdefault((target, source), _Edge())

    def observe(self, sample: TrackedTransform) -> None:
        """Record a sample, good or lost.

        A sample older than the newest is ignored; of two with the same stamp the lost one counts. A
        sample older by more than ``stale_after_ns`` is recorded: the clock was set back, or the
        newest stamp was from the future.
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
        """Forget all samples, as after a seek; keep the edges."""
        self._edges = {names: _Edge() for names in self._edges}

    def is_fresh(self, stamp_ns: int | None, now_ns: int) -> bool:
        """True if data of that stamp may be shown at ``now_ns``; False for None and the future."""
        return freshness_of(stamp_ns, now_ns, self._limits) is Freshness.VALID

    def check(self, now_ns: int) -> tuple[TransformHealth, ...]:
        """Health of each watched transform at ``now_ns``, in the order of their first samples."""
        return tuple(self._health(*names, edge, now_ns) for names, edge in self._edges.items())

    def _health(self, target: str, source: str, edge: _Edge, now_ns: int) -> TransformHealth:
        age_ns = None if edge.good_ns is None else now_ns - edge.good_ns
        freshness = freshness_of(None if edge.is_lost else edge.good_ns, now_ns, self._limits)
        if freshness is Freshness.FUTURE:
            # Indicators have no fourth colour; their text has "ahead" beside the age.
            freshness = Freshness.STALE
        return TransformHealth(join_transform_name(source, target), freshness, age_ns)


@dataclass(frozen=True, slots=True, eq=False)
class ShownMargin:
    """The state that colours the scene, and the text of its banner.

    ``proximity`` is None while the state is UNKNOWN. ``constraint`` is None unless it is current.
    """

    state: MarginState
    text: str
    proximity: Proximity | None = None
    constraint: Constraint | None = None


def shown_margin(
    decision: FixtureDecision | None, watchdog: TransformWatchdog | None, now_ns: int | None
) -> ShownMargin:
    """The margin to show at ``now_ns``; ``decision`` is None before the first one.

    Without ``watchdog`` the decision does not age.
    """
    if decision is None:
        return _unknown(age_text(None))
    is_known = decision.state is not MarginState.UNKNOWN
    constraint = decision.constraint if decision.constraint_is_current else None
    if watchdog is not None and now_ns is not None:
        stamp_ns = None if decision.stamp is None else decision.stamp.ns
        if not watchdog.is_fresh(stamp_ns, now_ns):
            if is_known or stamp_ns is not None:
                return _unknown(age_text(None if stamp_ns is None else now_ns - stamp_ns))
            constraint = None  # the reasons are in the decision
    if not is_known:
        text = banner(decision.state, None, decision.reasons)
        return ShownMargin(decision.state, text, constraint=constraint)
    if decision.proximity is None or not decision.proximity.is_finite:
        return _unknown("no distance")
    text = banner(decision.state, decision.proximity)
    return ShownMargin(decision.state, text, decision.proximity, constraint)


def banner(state: MarginState, proximity: Proximity | None, reasons: Iterable[Reason] = ()) -> str:
    """The state's name and description, and the signed distance in mm if it is known.

    For UNKNOWN also the faults among ``reasons``, worst first, at most `_MAX_REASONS`.
    """
    text = f"{state.name}: {state.display.description}"
    if state is MarginState.UNKNOWN:
        faults = [reason.value.replace("_", " ") for reason in reasons if reason.is_fault]
        return ", ".join([text, *faults[:_MAX_REASONS]])
    return text if proximity is None else f"{text}, {distance_text(proximity.signed_distance_mm)}"


def age_text(age_ns: int | None) -> str:
    """The reason why data of this age are not shown."""
    if age_ns is None:
        return "no data yet"
    if age_ns < 0:
        return f"data from {-age_ns / NS_PER_S:.1f} s ahead"
    return f"data {age_ns / NS_PER_S:.1f} s old"


def distance_text(signed_distance_mm: float) -> str:
    """The distance with its sign, to 0.1 mm."""
    return f"{signed_distance_mm:.1f} mm"


def _unknown(reason: str) -> ShownMargin:
    return ShownMargin(MarginState.UNKNOWN, f"{banner(MarginState.UNKNOWN, None)}, {reason}")
