"""Probability that a sensor repeats its pose exactly, learned from its own history.

Real trackers quantise: a sensor at rest repeats all digits, and a sensor that moves cannot. One
number for all of them would call a resting sensor frozen, or a stuck one current.
"""

import math
from collections import deque
from dataclasses import dataclass, field
from itertools import pairwise

from app.geometry import FreshnessLimits, Transform

IMPROBABLE = 1e-2
"""A run of repetitions that is less probable than this carries no information: it is old data."""

STUCK = 1e-6
"""Probability below which a source whose sensors all repeat at once is stuck."""

CONFIRMED_BY = 3
"""Runs of a length, or longer ones, that make it a known length. One fault does not teach it."""

REPEATS_AT_REST = 0.05
"""Share of repetitions at rest from which a sensor is known to repeat."""

REST_LIMIT = 5
"""A resting sensor that is known to repeat is frozen after this times ``frozen_after_ns``.

Its margin has grown long before. A run has no upper bound by itself: a value in the middle of a
quantisation step stays there. With the usual 1 s this is 5 s, nearly three times the longest run
of a resting tool in public recordings (1.75 s).
"""

MAX_SAMPLES = 2_000
"""Counts are halved beyond it, so that the history follows a change of the set-up."""

MIN_CHANGES = 30
"""Frames with a changed pose before a source can be called stuck."""

MIN_SENSORS = 2
"""Sensors of a tracker that must repeat together to say something on their source."""

_CHANGES_IN_MOTION = 100.0
"""A sensor in motion does not repeat, until its source is known to send poses twice."""

_POSITIONS = 4
_STRAIGHT = 0.7
_MIN_STEPS = 2.0
_STEP_OF_AXES = math.sqrt(2.0) * math.radians(0.25)
"""Change of a rotation matrix for 0.25 degrees, more than trackers quantise angles to."""


@dataclass(slots=True)
class RepetitionHistory:
    """Counts of samples that repeated the one before and of samples that differed from it.

    A run is a series of repetitions that ended with a change: the sensor was alive.
    """

    repeats: float = 0.0
    changes: float = 0.0
    runs: int = 0
    longest_ns: list[int] = field(default_factory=list)
    """Durations of the `CONFIRMED_BY` longest runs, longest first."""
    prior_changes: float = 1.0
    """Changes to one repetition that are assumed before there is a history."""

    def add_change(self) -> None:
        """Count a sample that differs from the one before."""
        self.changes += 1.0
        if self.changes + self.repeats > MAX_SAMPLES:
            self.changes, self.repeats = self.changes / 2.0, self.repeats / 2.0

    def add_run(self, repeats: int, duration_ns: int) -> None:
        """Count a run of ``repeats`` samples that has ended after ``duration_ns``."""
        self.repeats += repeats
        self.runs += 1
        self.longest_ns = sorted((*self.longest_ns, duration_ns), reverse=True)[:CONFIRMED_BY]

    @property
    def known_ns(self) -> int:
        """Duration that `CONFIRMED_BY` runs have reached; 0 without as many runs."""
        return self.longest_ns[-1] if len(self.longest_ns) == CONFIRMED_BY else 0

    @property
    def is_known_to_repeat(self) -> bool:
        """True if several runs have ended and repetitions are no exception."""
        share = self.repeats / max(1.0, self.repeats + self.changes)
        return self.runs >= CONFIRMED_BY and share >= REPEATS_AT_REST

    def is_improbable(self, repeats: int, duration_ns: int) -> bool:
        """True for a run longer than any known one whose probability is below `IMPROBABLE`."""
        return duration_ns > self.known_ns and self.probability(repeats) < IMPROBABLE

    def probability(self, repeats: int) -> float:
        """Probability that a run reaches ``repeats``, from the counts and the prior.

        Beta-binomial prediction: product of (k + 1 + i) / (n + 1 + b + i) over the repeats, with k
        repetitions in n samples and b ``prior_changes``. With b = 1, a uniform prior, it is
        1 / (repeats + 1) without a history: nothing is improbable.
        """
        k = self.repeats + 1.0
        n = k + self.changes + self.prior_changes
        log = math.lgamma(k + repeats) - math.lgamma(k) + math.lgamma(n) - math.lgamma(n + repeats)
        return math.exp(log)


@dataclass(slots=True)
class SensorRepetition:
    """History of one sensor, at rest and in motion, and the run of repetitions that goes on.

    A sensor is in motion if its last changes led into one direction and the next sample, at that
    speed, lies at least two quantisation steps away. The smallest change of the position in its
    history is the step.
    """

    at_rest: RepetitionHistory = field(default_factory=RepetitionHistory)
    in_motion: RepetitionHistory = field(
        default_factory=lambda: RepetitionHistory(prior_changes=_CHANGES_IN_MOTION)
    )
    repeats: int = 0
    duration_ns: int = 0
    moving: bool = False
    """True if the sensor was in motion at its last change."""
    _step_mm: float = math.inf
    _last: deque[tuple[int, list[float], Transform, float]] = field(
        default_factory=lambda: deque(maxlen=_POSITIONS)
    )
    """Time, position and pose of the last changes, and the distance from the one before in mm."""

    def repeat(self, duration_ns: int) -> None:
        """Count a sample that repeats the pose of ``duration_ns`` ago."""
        if duration_ns <= self.duration_ns:
            return  # the same sample again
        if self.repeats == 0 and not self.moving:
            self.moving = self._is_turning()
        self.repeats += 1
        self.duration_ns = duration_ns

    def begin(self, pose: Transform, position_mm: list[float], at_ns: int) -> None:
        """Note the first pose, which neither repeats nor changes one."""
        self._last.append((at_ns, position_mm, pose, 0.0))

    def change(
        self, pose: Transform, position_mm: list[float], at_ns: int, limits: FreshnessLimits
    ) -> None:
        """Count a sample with another pose, which ends a run; a frozen run is not learned.

        ``position_mm`` is that of ``pose``.
        """
        history, last = self.in_motion if self.moving else self.at_rest, self._last
        if self.repeats:
            if not limits.is_frozen(self.unchanged_ns(limits)):
                history.add_run(self.repeats, self.duration_ns)
            self.repeats = self.duration_ns = 0
        history.add_change()
        step_mm = 0.0
        if last:
            step_mm = math.dist(last[-1][1], position_mm)
            if 0.0 < step_mm < self._step_mm:
                self._step_mm = step_mm
        last.append((at_ns, position_mm, pose, step_mm))
        self.moving = False
        if len(last) == _POSITIONS:
            first, second, third, _ = last
            path_mm = second[3] + third[3] + step_mm
            net_mm = math.dist(first[1], position_mm)
            self.moving = _leads_on(first[0], third[0], at_ns, path_mm, net_mm, self._step_mm)

    def restart(self) -> None:
        """Forget the present run and motion, not the history: the clock has jumped."""
        self.repeats = self.duration_ns = 0
        self.moving = False
        self._last.clear()

    def unchanged_ns(
        self, limits: FreshnessLimits, source: "SourceRepetition | None" = None
    ) -> int:
        """Time in ns since the last change if the repetition is improbable, otherwise 0.

        A run is improbable by the sensor's own history, or because all sensors of ``source`` repeat
        for improbably long. A value above ``limits.frozen_after_ns`` is frozen: every run that is
        longer, except that of a sensor which rests and is known to repeat at rest. That one is
        frozen after `REST_LIMIT` times the limit, or when all sensors repeat for longer than the
        limit.
        """
        duration_ns, frozen_ns = self.duration_ns, limits.frozen_after_ns
        if self.repeats == 0:
            return 0
        history = self._history()
        all_improbable = source is not None and source.is_improbable()
        improbable = all_improbable or history.is_improbable(self.repeats, duration_ns)
        if frozen_ns is None:
            return duration_ns if improbable else 0
        all_frozen = source is not None and all_improbable and source.duration_ns > frozen_ns
        rests = not self.moving and history.is_known_to_repeat and not all_frozen
        if duration_ns > (REST_LIMIT * frozen_ns if rests else frozen_ns):
            return duration_ns
        return min(duration_ns, frozen_ns) if improbable else 0

    def _history(self) -> RepetitionHistory:
        return self.in_motion if self.moving else self.at_rest

    def _is_turning(self) -> bool:
        """True if the orientation was in motion; computed when a run begins, which is rare."""
        if len(self._last) < _POSITIONS:
            return False
        axes = [pose.rotation.ravel().tolist() for _, _, pose, _ in self._last]
        path = sum(math.dist(a, b) for a, b in pairwise(axes))
        times = [each[0] for each in self._last]
        net = math.dist(axes[0], axes[-1])
        return _leads_on(times[0], times[-2], times[-1], path, net, _STEP_OF_AXES)


@dataclass(slots=True)
class SourceRepetition:
    """History of the frames of one tracker, in which two sensors or more were measured."""

    together: RepetitionHistory = field(default_factory=RepetitionHistory)
    """Frames in which all sensors repeated, against all others."""
    any_repeats: float = 0.0
    frames: float = 0.0
    repeats: int = 0
    duration_ns: int = 0

    def observe(self, durations_ns: list[int], stale_after_ns: int) -> None:
        """Count a frame with the time since the last change of each of its sensors, 0 for a change.

        A frame with one sensor counts only if it changed: it ends a run.
        """
        shortest_ns = min(durations_ns)
        if len(durations_ns) < MIN_SENSORS and (shortest_ns or not self.repeats):
            return
        if shortest_ns:
            self.repeats += 1
            self.duration_ns = shortest_ns
            return
        if self.repeats and not self.is_stuck(stale_after_ns):
            self.together.add_run(self.repeats, self.duration_ns)
            self.any_repeats += self.repeats
            self.frames += self.repeats
        self.repeats = self.duration_ns = 0
        self.together.add_change()
        self.frames += 1.0
        self.any_repeats += any(durations_ns)
        if self.frames > MAX_SAMPLES:
            self.frames, self.any_repeats = self.frames / 2.0, self.any_repeats / 2.0

    def restart(self) -> None:
        """Forget the present run, not the history: the clock has jumped."""
        self.repeats = self.duration_ns = 0

    def is_improbable(self) -> bool:
        """True if all sensors repeat, for longer than is probable in the source's history."""
        return self.repeats > 0 and self.together.is_improbable(self.repeats, self.duration_ns)

    def is_stuck(self, stale_after_ns: int) -> bool:
        """True if all sensors repeat, for longer than data may be old, and never did before.

        The share of frames in which any sensor repeated is the bound for one repetition of all:
        a tool that comes to rest for the first time quantises as the other sensors do.
        """
        if self.duration_ns <= stale_after_ns or self.frames - self.any_repeats < MIN_CHANGES:
            return False
        share = (self.any_repeats + 1.0) / (self.frames + 2.0)
        return share**self.repeats < STUCK


def _leads_on(
    first_ns: int, before_ns: int, last_ns: int, path: float, net: float, step: float
) -> bool:
    """True for a straight path whose next sample is at least two steps away at its mean speed.

    ``path`` is the length through all points, ``net`` that from the first to the last of them;
    ``before_ns`` is the time of the last but one.
    """
    elapsed_ns = last_ns - first_ns
    if elapsed_ns <= 0 or net < _STRAIGHT * path:
        return False
    return net * (last_ns - before_ns) >= _MIN_STEPS * step * elapsed_ns
