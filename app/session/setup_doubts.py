"""Set-ups that cannot be right, found in the steps of a session: said before they mislead.

They change no decision. Each text has the form "what: problem; expected what is allowed".
"""

from collections import Counter, deque
from collections.abc import Iterable
from dataclasses import dataclass, field
from math import isfinite
from statistics import median
from typing import Protocol

import numpy as np

from app.fixture import MarginParameters, MarginState
from app.geometry import (
    NS_PER_MS,
    NS_PER_S,
    FloatArray,
    TrackedTransform,
    Transform,
    rotation_angle,
)
from app.session.setup import REFERENCE
from app.session.step_result import StepResult

FAR_MM = 1000.0
"""A tool that is never nearer to the tumour than this is in no operating room's field."""
MAX_UNUSABLE = 0.2
"""Fraction of frames that may be unusable."""
_MIN_STEPS = 50
"""Steps before a fraction or a distance is judged."""
_TIP_MM = 1e-3
_MIN_PERIODS = 20
_STILL_MM, _STILL_RAD = 0.01, 2e-5
"""A sensor that stays within this moves less than the noise of any tracker."""
_STILL_NS = 10 * NS_PER_S
_EVERY = 25
"""The texts are renewed each so many steps."""


@dataclass(slots=True)
class _SensorTrail:
    """History of one sensor: its periods, its first pose, and whether it has stayed there."""

    first_mm: FloatArray
    first_rotation: FloatArray
    began_ns: int
    last_ns: int
    still: bool = True
    periods_ns: deque[int] = field(default_factory=lambda: deque(maxlen=200))

    def add(self, sample: TrackedTransform) -> None:
        now_ns = sample.stamp.ns
        if now_ns > self.last_ns:
            self.periods_ns.append(now_ns - self.last_ns)
        self.last_ns = max(self.last_ns, now_ns)
        pose = sample.transform
        if pose is None or not self.still:
            return
        moved_mm = float(np.abs(pose.translation_mm - self.first_mm).max())
        self.still = moved_mm <= _STILL_MM and (
            rotation_angle(self.first_rotation.T @ pose.rotation) <= _STILL_RAD
        )


class DoubtedSetup(Protocol):
    """Frames and margins of a session: a `SessionSetup`, or the content of one."""

    @property
    def margins(self) -> MarginParameters:
        """The margins."""

    @property
    def tool_from_tip(self) -> Transform:
        """The tip in the tool's tracked frame."""

    @property
    def frame_from_tumor(self) -> Transform:
        """The tumour in the tracked frame that it moves with."""


class SetupDoubts:
    """Call `observe` with each step; `texts` are the doubts so far.

    ``setup`` names the frames; ``stale_after_ns`` may be set to that of new margins.
    """

    def __init__(self, setup: DoubtedSetup) -> None:
        self.stale_after_ns = setup.margins.stale_after_ns
        self._tool = setup.tool_from_tip.target
        self._tip_is_origin = False
        self.use_tip(setup.tool_from_tip)
        self._resting = {REFERENCE, setup.frame_from_tumor.target}
        self._watched = {self._tool, *self._resting}
        self._trails: dict[str, _SensorTrail] = {}
        self._steps = self._unusable = 0
        self._faults: Counter[str] = Counter()
        self._nearest_mm: float | None = None
        self._texts: tuple[str, ...] = ()
        self._renewed = 0

    def observe(self, step: StepResult) -> tuple[str, ...]:
        """Add the next step; return the doubts, which are renewed from time to time."""
        if not step.frame.poses:
            return self._texts  # a step of the watchdog, not of the tracker
        decision = step.decision
        self._steps += 1
        if decision.state is MarginState.UNKNOWN:
            self._unusable += 1
            self._faults.update(reason.text for reason in decision.reasons[:1])
        if decision.proximity is not None:
            distance_mm = decision.proximity.signed_distance_mm
            if isfinite(distance_mm):
                nearest_mm = self._nearest_mm
                self._nearest_mm = (
                    distance_mm if nearest_mm is None else min(nearest_mm, distance_mm)
                )
        for sample in step.frame.poses:
            if sample.source in self._watched and sample.transform is not None:
                self._add(sample)
        if self._steps == 1 or self._steps - self._renewed >= _EVERY:
            self._renewed = self._steps
            self._texts = self.texts()
        return self._texts

    def use_tip(self, tool_from_tip: Transform) -> None:
        """Use this tip from now on; the doubts are renewed with the next ones."""
        at_origin = float(np.abs(tool_from_tip.translation_mm).max()) < _TIP_MM
        self._tip_is_origin = at_origin and not self._tool.lower().endswith("tip")

    def texts(self) -> tuple[str, ...]:
        """The doubts about all steps so far."""
        return tuple(self._find())

    def _add(self, sample: TrackedTransform) -> None:
        trail = self._trails.get(sample.source)
        if trail is not None:
            trail.add(sample)
        elif sample.transform is not None:
            pose, now_ns = sample.transform, sample.stamp.ns
            self._trails[sample.source] = _SensorTrail(
                pose.translation_mm, pose.rotation, now_ns, now_ns
            )

    def _find(self) -> Iterable[str]:
        if self._tip_is_origin:
            yield (
                f"tool.tip_from: the tip is at the origin of the sensor {self._tool!r}; expected "
                "the offset of a pivot calibration, unless the tracker reports the tip itself"
            )
        if self._nearest_mm is not None and self._nearest_mm > FAR_MM and self._has_steps:
            yield (
                f"tumor: the tool is never nearer than {self._nearest_mm / 1000.0:.2f} m; expected "
                f"less than {FAR_MM / 1000.0:g} m: check tumor.frame, tumor.pose and the units of "
                "the mesh"
            )
        yield from self._slow_tracker()
        yield from self._still_sensors()
        share = self._unusable / max(self._steps, 1)
        if self._has_steps and share > MAX_UNUSABLE:
            (cause, _), *_ = self._faults.most_common(1)
            yield (
                f"tracking: {100.0 * share:.0f} % of {self._steps} frames are unusable, most of "
                f"them because {cause}; expected {100.0 * MAX_UNUSABLE:.0f} % at most"
            )

    @property
    def _has_steps(self) -> bool:
        return self._steps >= _MIN_STEPS

    def _slow_tracker(self) -> Iterable[str]:
        for frame, trail in sorted(self._trails.items()):
            if len(trail.periods_ns) < _MIN_PERIODS:
                continue
            period_ns = median(trail.periods_ns)
            if period_ns > self.stale_after_ns:
                yield (
                    f"margins.stale_after_ms: is {self.stale_after_ns / NS_PER_MS:g}; expected "
                    f"more than {period_ns / NS_PER_MS:.0f}, the period in ms at which the tracker "
                    f"sends {frame!r}"
                )

    def _still_sensors(self) -> Iterable[str]:
        for frame, trail in sorted(self._trails.items()):
            watched_ns = trail.last_ns - trail.began_ns
            if frame in self._resting and trail.still and watched_ns >= _STILL_NS:
                yield (
                    f"frame {frame!r}: has not moved by {_STILL_MM} mm in "
                    f"{watched_ns / NS_PER_S:.0f} s; expected the noise and the motion of a sensor "
                    "on the patient: check that it is attached and measured"
                )
