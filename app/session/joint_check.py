"""Joints against tracker: finds a tool that is not where the joints and the registration place it.

Three limits: of a single difference, of their mean, and of a sudden change.
"""

import math
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass

from app.case import JointSample
from app.geometry import NS_PER_S, Stamp, Transform
from app.registration import RegistrationDrift, check_drift
from app.session.relations import ENDS_AFTER_NS
from app.session.sensor_motion import (
    MAX_SIGMA_MM,
    MIN_SIGMA_MM,
    MOVING_MM_S,
    SIGMAS,
    STAMP_ERROR_S,
    WINDOW_NS,
    ZERO,
    SensorNoise,
    Vector,
)
from app.session.setup import RobotSetup

MEAN_S = 0.25
"""Time constant of the mean. It removes the jitter of the tracker, so that a difference that stays
is found below the bound of a single one; a constant error of velocity v appears as v times this."""

SHARE_OF_BOUND = 0.5
"""Default limit, as a share of the bound of a single difference. In the simulated case, with a
registration error, breath and jitter, the mean reaches a quarter of the bound of 5 mm."""

START_NS = NS_PER_S
"""Time after the first difference from which the mean's start is fixed: four time constants."""


class MeanDrift:
    """Mean of differences (3,) in mm, tracked minus predicted, with exponential weights.

    It is exceeded if both the mean and its change since the start are longer than ``limit_mm``: the
    error of an accepted registration, which is there from the start, is no drift. An error that
    grows at ``r`` mm/s from 0 is found before it is ``limit_mm + r * MEAN_S``, and from a constant
    error of ``e`` mm before ``limit_mm + e + r * MEAN_S``.
    """

    def __init__(self, limit_mm: float) -> None:
        self.limit_mm = limit_mm
        self._mean: Vector = ZERO
        self._start: Vector = ZERO
        self._first_ns: int | None = None
        self._last_ns = 0
        self._elapsed_ns = 0
        """Time measured before the clock was set back."""

    @property
    def start(self) -> Vector:
        """The mean at its start: the error of the accepted registration."""
        return self._start

    @property
    def length_mm(self) -> float:
        """Length of the mean."""
        return math.hypot(*self._mean)

    def update(self, difference: Vector, now: Stamp) -> None:
        """Add a difference measured at ``now``."""
        since_ns = now.ns - self._last_ns
        if self._first_ns is None:
            self._first_ns, since_ns = now.ns, 0
            self._mean = self._start = difference
        elif since_ns < 0:  # the source's clock was set back: what has drifted stays drifted
            self._elapsed_ns += self._last_ns - self._first_ns
            self._first_ns, since_ns = now.ns, 0
            self._mean = difference
        self._last_ns = now.ns
        self._mean = _between(self._mean, difference, _share(since_ns))
        if self._elapsed_ns + now.ns - self._first_ns <= START_NS:
            self._start = self._mean

    @property
    def exceeded(self) -> bool:
        """True if the mean has left its limit."""
        return self.length_mm > self.limit_mm and math.dist(self._mean, self._start) > self.limit_mm

    @property
    def text(self) -> str:
        """The mean and its limit."""
        return (
            f"the tool is {self.length_mm:.3g} mm from its position by the joints in the mean; "
            f"expected at most {self.limit_mm:g} mm"
        )


GAP_NS = NS_PER_S // 4
"""Differences that are further apart are not compared: the error of a registration changes with the
place of the tool."""


@dataclass(frozen=True, slots=True)
class _Positions:
    """The tip by tracker and by joints at one time."""

    ns: int
    tracked: Vector
    predicted: Vector

    @property
    def difference(self) -> Vector:
        return _difference(self.tracked, self.predicted)

    def is_repeated(self, before: "_Positions") -> bool:
        """True for the same time, or the same tracked position although the joints move."""
        moved_mm = math.dist(self.predicted, before.predicted)
        moves = moved_mm * NS_PER_S > MOVING_MM_S * (self.ns - before.ns)
        return self.ns == before.ns or (moves and self.tracked == before.tracked)

    def velocity_since(self, before: "_Positions") -> Vector:
        """Velocity by the joints in mm/s."""
        seconds = (self.ns - before.ns) / NS_PER_S
        x, y, z = _difference(self.predicted, before.predicted)
        return (x / seconds, y / seconds, z / seconds)


class SuddenChange:
    """Finds a change of the difference within two differences, whatever the registration's error.

    The mean of the last two is compared with the mean before them, which has exponential weights
    with the time constant `MEAN_S`. It may be ``limit_mm`` off or, if that is more, `SIGMAS`
    standard deviations, learned by `SensorNoise`, plus `STAMP_ERROR_S` times the change of the
    velocity: an error of the joints' clock appears as a difference when the tool begins to move.

    The finding ends when for `ENDS_AFTER_NS` the difference has been as near to its mean before the
    change, or to that of the session's start.
    """

    def __init__(self, limit_mm: float) -> None:
        self._limit_mm = limit_mm
        self._noise = SensorNoise(MIN_SIGMA_MM, MAX_SIGMA_MM)
        self._last: deque[_Positions] = deque()
        """The last three positions at least, and those of `WINDOW_NS`."""
        self._mean: Vector = ZERO
        self._velocity: Vector = ZERO
        self._count = 0
        self._allowed_mm = 0.0
        self._near_since_ns: int | None = None
        self.text = ""
        """The change and its limit; empty if there is none."""

    def update(self, tracked: Vector, predicted: Vector, start: Vector, ns: int) -> None:
        """Add the tip's positions in mm at ``ns``, after new joints.

        ``start`` is the difference at the session's start. A pose that a driver repeats while the
        tool moves is not used.
        """
        if self._last and not 0 <= ns - self._last[-1].ns <= GAP_NS:
            self._last.clear()
        new = _Positions(ns, tracked, predicted)
        if self._last and new.is_repeated(self._last[-1]):
            return
        self._last.append(new)
        if len(self._last) == 1 and not self.text:
            self._mean, self._velocity, self._count = new.difference, ZERO, 1
        while len(self._last) > 3 and self._last[1].ns <= ns - WINDOW_NS:
            self._last.popleft()
        if len(self._last) < 3:
            return
        before = self._last[-2]
        two = _between(before.difference, new.difference, 0.5)
        off_mm = math.dist(two, self._mean)
        if self.text:
            self._end(min(off_mm, math.dist(two, start)), ns)
            return
        velocity = new.velocity_since(self._last[0])
        noise_mm = SIGMAS * math.sqrt(self._noise.variance)
        lag_mm = STAMP_ERROR_S * math.dist(velocity, self._velocity)
        self._allowed_mm = max(self._limit_mm, noise_mm + lag_mm)
        if off_mm > self._allowed_mm:
            self._near_since_ns = None
            self.text = (
                f"the tool moves by {off_mm:.3g} mm against its position by the joints within two "
                f"samples; expected at most {self._allowed_mm:.3g} mm"
            )
            return
        self._noise.update(off_mm * off_mm, 1.0)
        self._count += 1
        share = max(_share(ns - before.ns), 1.0 / self._count)
        self._mean = _between(self._mean, before.difference, share)
        self._velocity = _between(self._velocity, velocity, share)

    def _end(self, off_mm: float, ns: int) -> None:
        """End the finding if the difference is, and has been, back for long enough."""
        if off_mm > self._allowed_mm:
            self._near_since_ns = None
        elif self._near_since_ns is None or ns < self._near_since_ns:
            self._near_since_ns = ns
        elif ns - self._near_since_ns >= ENDS_AFTER_NS:
            self.text = ""
            self._last.clear()


def _share(duration_ns: int) -> float:
    """Weight of a value beside a mean that is ``duration_ns`` older."""
    return 1.0 - math.exp(-duration_ns / (MEAN_S * NS_PER_S))


def _difference(a: Vector, b: Vector) -> Vector:
    (a1, a2, a3), (b1, b2, b3) = a, b
    return (a1 - b1, a2 - b2, a3 - b3)


def _between(a: Vector, b: Vector, share: float) -> Vector:
    (a1, a2, a3), (b1, b2, b3) = a, b
    return (a1 + share * (b1 - a1), a2 + share * (b2 - a2), a3 + share * (b3 - a3))


class JointCheck:
    """Compares the tracked tip with its prediction by joints and registration.

    ``mean_mm`` is the limit of `MeanDrift` and of `SuddenChange`; None takes `SHARE_OF_BOUND` of
    the bound of a single difference.
    """

    def __init__(self, robot: RobotSetup | None, mean_mm: float | None) -> None:
        self._robot = robot
        self._reference_from_root = _reference_from_root(robot)
        bound_mm = 1.0 if robot is None else robot.max_drift.translation_mm
        limit_mm = SHARE_OF_BOUND * bound_mm if mean_mm is None else mean_mm
        self._mean = MeanDrift(limit_mm)
        self._change = SuddenChange(limit_mm)
        self._joints_ns: int | None = None
        self._drift: RegistrationDrift | None = None
        self._silent = False

    @property
    def is_configured(self) -> bool:
        """True if the robot has joints and a registration: it can contradict the tracker."""
        robot = self._robot
        return robot is not None and not robot.follows_tool and robot.registration is not None

    @property
    def is_silent(self) -> bool:
        """True if the configured joints are not known now: nothing checks the tracker."""
        return self._silent

    def drifts(self) -> dict[str, str]:
        """The single difference, mean and change that are beyond their limits: one line each.

        A drift does not end when the joint states stop.
        """
        drifts = {}
        if self._drift is not None and not self._drift.accepted:
            drifts["single"] = self._drift.reason
        if self._mean.exceeded:
            drifts["mean"] = self._mean.text
        if self._change.text:
            drifts["change"] = self._change.text
        return drifts

    def update(
        self,
        links: Mapping[str, Transform],
        joints: JointSample | None,
        reference_from_tip: Transform | None,
        now: Stamp,
    ) -> RegistrationDrift | None:
        """Difference at ``now`` between the tracked ``reference_from_tip`` and its prediction.

        ``links`` are ``root_from_link`` by ``joints``, empty while the joints are not known. None
        where one of the two is not known.
        """
        self._silent = self.is_configured and not links
        robot = self._robot
        if (
            robot is None
            or robot.follows_tool
            or self._reference_from_root is None
            or not links
            or reference_from_tip is None
        ):
            return None
        link = self._reference_from_root @ links[robot.tool_link]
        # Without a known mount the link gives the tip's position, not its orientation.
        predicted = (
            Transform.unchecked(
                link.target,
                reference_from_tip.source,
                reference_from_tip.rotation,
                link.translation_mm,
            )
            if robot.link_from_tip is None
            else link @ robot.link_from_tip
        )
        tracked, placed = _vector(reference_from_tip), _vector(predicted)
        self._mean.update(_difference(tracked, placed), now)
        joints_ns = None if joints is None else joints.stamp.ns
        if joints_ns != self._joints_ns:
            self._joints_ns = joints_ns
            self._change.update(tracked, placed, self._mean.start, now.ns)
        self._drift = check_drift(predicted, reference_from_tip, robot.max_drift)
        return self._drift


def _vector(pose: Transform) -> Vector:
    x, y, z = pose.translation_mm.tolist()
    return (x, y, z)


def _reference_from_root(robot: RobotSetup | None) -> Transform | None:
    """The registration with the base renamed to the robot's root link: they are one frame."""
    if robot is None or robot.registration is None:
        return None
    return robot.registration.transform.renamed(source=robot.robot.root_link)
