"""Joints against tracker: finds a tool that is not where the joints and the registration place it.

Three limits: of a single difference, of their mean, and of a sudden change.
"""

import math
from collections.abc import Mapping

import numpy as np

from app.case import JointSample
from app.fixture.jit import inlined, kernel, renew_with
from app.fixture.vectors import (
    Vector,
    add_scaled,
    dot,
    length,
    point_distance,
    row,
    sub,
    transform_point,
    turn_between,
)
from app.geometry import NS_PER_S, FloatArray, Stamp, Transform
from app.registration import RegistrationDrift
from app.session import relations, sensor_motion
from app.session.relations import ENDS_AFTER_NS
from app.session.sensor_motion import (
    MAX_POSES,
    MAX_SIGMA_MM,
    MIN_SIGMA_MM,
    MOVING_MM_S,
    SIGMAS,
    STAMP_ERROR_S,
    WINDOW_NS,
    State,
    drop_first,
    learned_variance,
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


_NONE: Vector = (0.0, 0.0, 0.0)

_MEAN = np.dtype(
    [
        ("limit_mm", np.float64),
        ("known", np.bool_),  # True from the first difference on
        ("mean", np.float64, 3),
        ("start", np.float64, 3),  # the mean at its start
        ("first_ns", np.int64),
        ("last_ns", np.int64),
        ("elapsed_ns", np.int64),  # time measured before the clock was set back
    ],
    align=True,
)


class MeanDrift:
    """Mean of differences (3,) in mm, tracked minus predicted, with exponential weights.

    It is exceeded if both the mean and its change since the start are longer than ``limit_mm``: the
    error of an accepted registration, which is there from the start, is no drift. An error that
    grows at ``r`` mm/s from 0 is found before it is ``limit_mm + r * MEAN_S``, and from a constant
    error of ``e`` mm before ``limit_mm + e + r * MEAN_S``.
    """

    def __init__(self, limit_mm: float) -> None:
        # Run the kernel once, so that the first step does not wait for the compiler.
        _update_mean(np.zeros(1, _MEAN), _NONE, 0)
        self._state: State = np.zeros(1, _MEAN)
        self._state["limit_mm"] = limit_mm
        self.exceeded = False
        """True if the mean has left its limit."""

    @property
    def start(self) -> FloatArray:
        """The mean (3,) at its start: the error of the accepted registration."""
        return np.asarray(self._state["start"][0])

    @property
    def length_mm(self) -> float:
        """Length of the mean."""
        return math.hypot(*self._state["mean"][0].tolist())

    def update(self, difference: Vector, now: Stamp) -> None:
        """Add a difference measured at ``now``."""
        self.exceeded = _update_mean(self._state, difference, now.ns)

    @property
    def text(self) -> str:
        """The mean and its limit."""
        return (
            f"the tool is {self.length_mm:.3g} mm from its position by the joints in the mean; "
            f"expected at most {self._state['limit_mm'][0]:g} mm"
        )


@kernel
def _update_mean(state: State, difference: Vector, ns: int) -> bool:
    """`MeanDrift.update` for a difference in mm; True if the mean has left its limit."""
    s = state[0]
    mean, since_ns = _vector(s["mean"]), ns - s["last_ns"]
    if not s["known"] or since_ns < 0:
        if not s["known"]:
            _set(s["start"], difference)
        else:  # the source's clock was set back: what has drifted stays drifted
            s["elapsed_ns"] += s["last_ns"] - s["first_ns"]
        s["known"], s["first_ns"] = True, ns
        mean, since_ns = difference, 0
    s["last_ns"] = ns
    mean = _between(mean, difference, _share(since_ns))
    _set(s["mean"], mean)
    if s["elapsed_ns"] + ns - s["first_ns"] <= START_NS:
        _set(s["start"], mean)
    limit_mm = s["limit_mm"]
    changed_mm = point_distance(mean, _vector(s["start"]))
    return bool(length(mean) > limit_mm and changed_mm > limit_mm)


GAP_NS = NS_PER_S // 4
"""Differences that are further apart are not compared: the error of a registration changes with the
place of the tool."""

_CHANGE = np.dtype(
    [
        ("limit_mm", np.float64),
        ("variance", np.float64),  # of the differences per axis, in mm^2
        ("count", np.int64),  # of positions that are kept: three at least, and those of `WINDOW_NS`
        ("ns", np.int64, MAX_POSES),
        ("at", np.float64, (MAX_POSES, 2, 3)),  # the tip by the tracker and by the joints, in mm
        ("mean", np.float64, 3),
        ("velocity", np.float64, 3),  # mean by the joints, in mm/s
        ("samples", np.int64),  # of both means
        ("found", np.bool_),
        ("off_mm", np.float64),
        ("allowed_mm", np.float64),
        ("near", np.bool_),  # True if the difference is back since ``near_since_ns``
        ("near_since_ns", np.int64),
    ],
    align=True,
)


class SuddenChange:
    """Finds a change of the difference within two differences, whatever the registration's error.

    The mean of the last two is compared with the mean before them, which has exponential weights
    with the time constant `MEAN_S`. It may be ``limit_mm`` off or, if that is more, `SIGMAS`
    standard deviations, learned by `learned_variance`, plus `STAMP_ERROR_S` times the change of the
    velocity: an error of the joints' clock appears as a difference when the tool begins to move.

    The finding ends when for `ENDS_AFTER_NS` the difference has been as near to its mean before the
    change, or to that of the session's start.
    """

    def __init__(self, limit_mm: float) -> None:
        _update_change(np.zeros(1, _CHANGE), _NONE, _NONE, np.zeros(3), 0)  # as above
        self._state: State = np.zeros(1, _CHANGE)
        self._state["limit_mm"], self._state["variance"] = limit_mm, MAX_SIGMA_MM**2
        self.found = False
        """True from a change on until it ends."""

    @property
    def text(self) -> str:
        """The change and its limit; empty if there is none."""
        if not self.found:
            return ""
        state = self._state[0]
        return (
            f"the tool moves by {state['off_mm']:.3g} mm against its position by the joints within "
            f"two samples; expected at most {state['allowed_mm']:.3g} mm"
        )

    def update(self, tracked: Vector, predicted: Vector, start: FloatArray, ns: int) -> None:
        """Add the tip's positions in mm at ``ns``, after new joints.

        ``start`` (3,) is the difference at the session's start. A pose that a driver repeats while
        the tool moves is not used.
        """
        self.found = _update_change(self._state, tracked, predicted, start, ns)


@kernel
def _update_change(
    state: State, tracked: Vector, predicted: Vector, start: FloatArray, ns: int
) -> bool:
    """`SuddenChange.update`; True while there is a change."""
    s = state[0]
    if s["count"] > 0 and not 0 <= ns - s["ns"][s["count"] - 1] <= GAP_NS:
        s["count"] = 0
    if s["count"] > 0 and _is_repeated(s, tracked, predicted, ns):
        return bool(s["found"])
    if s["count"] == MAX_POSES:
        drop_first(s)
    new = s["count"]
    s["count"], s["ns"][new] = new + 1, ns
    _set(s["at"][new, 0], tracked)
    _set(s["at"][new, 1], predicted)
    difference = sub(tracked, predicted)
    if new == 0 and not s["found"]:
        _set(s["mean"], difference)
        _set(s["velocity"], _NONE)
        s["samples"] = 1
    while s["count"] > 3 and s["ns"][1] <= ns - WINDOW_NS:
        drop_first(s)
    new = s["count"] - 1
    if new < 2:
        return bool(s["found"])
    before = sub(row(s["at"][new - 1], 0), row(s["at"][new - 1], 1))
    two, mean = _between(before, difference, 0.5), _vector(s["mean"])
    off_mm = point_distance(two, mean)
    if s["found"]:
        _end(s, min(off_mm, point_distance(two, _vector(start))), ns)
        return bool(s["found"])
    x, y, z = sub(predicted, row(s["at"][0], 1))
    seconds = (ns - s["ns"][0]) / NS_PER_S
    velocity, mean_velocity = (x / seconds, y / seconds, z / seconds), _vector(s["velocity"])
    noise_mm = SIGMAS * math.sqrt(s["variance"])
    lag_mm = STAMP_ERROR_S * point_distance(velocity, mean_velocity)
    s["allowed_mm"] = max(s["limit_mm"], noise_mm + lag_mm)
    if off_mm > s["allowed_mm"]:
        s["found"], s["off_mm"], s["near"] = True, off_mm, False
        return True
    s["variance"] = learned_variance(
        s["variance"], off_mm * off_mm, 1.0, MIN_SIGMA_MM, MAX_SIGMA_MM
    )
    s["samples"] += 1
    share = max(_share(ns - s["ns"][new - 1]), 1.0 / s["samples"])
    _set(s["mean"], _between(mean, before, share))
    _set(s["velocity"], _between(mean_velocity, velocity, share))
    return False


@kernel
def _is_repeated(s: State, tracked: Vector, predicted: Vector, ns: int) -> bool:
    """True for the same time, or the same tracked position although the joints move."""
    last = s["count"] - 1
    since_ns = ns - s["ns"][last]
    moved_mm = point_distance(predicted, row(s["at"][last], 1))
    moves = moved_mm * NS_PER_S > MOVING_MM_S * since_ns
    return since_ns == 0 or (moves and tracked == row(s["at"][last], 0))


@kernel
def _end(s: State, off_mm: float, ns: int) -> None:
    """End the finding if the difference is, and has been, back for long enough."""
    if off_mm > s["allowed_mm"]:
        s["near"] = False
    elif not s["near"] or ns < s["near_since_ns"]:
        s["near"], s["near_since_ns"] = True, ns
    elif ns - s["near_since_ns"] >= ENDS_AFTER_NS:
        s["found"], s["count"] = False, 0


@inlined
def _share(duration_ns: int) -> float:
    """Weight of a value beside a mean that is ``duration_ns`` older."""
    return 1.0 - math.exp(-duration_ns / (MEAN_S * NS_PER_S))


@inlined
def _between(a: Vector, b: Vector, share: float) -> Vector:
    return add_scaled(a, share, sub(b, a))


@inlined
def _vector(a: FloatArray) -> Vector:
    return (a[0], a[1], a[2])


@inlined
def _set(a: FloatArray, v: Vector) -> None:
    a[0], a[1], a[2] = v


renew_with(_update_change, sensor_motion.__file__, relations.__file__)
renew_with(_end, relations.__file__)


class JointCheck:
    """Compares the tracked tip with its prediction by joints and registration.

    ``mean_mm`` is the limit of `MeanDrift` and of `SuddenChange`; None takes `SHARE_OF_BOUND` of
    the bound of a single difference.
    """

    def __init__(self, robot: RobotSetup | None, mean_mm: float | None) -> None:
        self._robot = robot
        self.is_configured = bool(robot and robot.registration and not robot.follows_tool)
        """True if the robot has joints and a registration: it can contradict the tracker."""
        self._poses = np.tile(np.eye(3), (6, 1, 1)), np.zeros((6, 3))
        if robot is not None and robot.registration is not None:
            self._place(_BASE, robot.registration.transform)  # base and root are one frame
        if robot is not None and robot.link_from_tip is not None:
            self._place(_MOUNT, robot.link_from_tip)
        _compare(*self._poses, True)  # as above
        bound_mm = 1.0 if robot is None else robot.max_drift.translation_mm
        limit_mm = SHARE_OF_BOUND * bound_mm if mean_mm is None else mean_mm
        self._mean = MeanDrift(limit_mm)
        self._change = SuddenChange(limit_mm)
        self._joints_ns: int | None = None
        self._drift: RegistrationDrift | None = None
        self.is_silent = False
        """True if the configured joints are not known now: nothing checks the tracker."""

    def drifts(self) -> dict[str, str]:
        """The single difference, mean and change that are beyond their limits: one line each.

        A drift does not end when the joint states stop.
        """
        drifts = {}
        if self._drift is not None and not self._drift.accepted:
            drifts["single"] = self._drift.reason
        if self._mean.exceeded:
            drifts["mean"] = self._mean.text
        if self._change.found:
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
        self.is_silent = self.is_configured and not links
        robot = self._robot
        if robot is None or not self.is_configured or not links or reference_from_tip is None:
            return None
        self._place(_LINK, links[robot.tool_link])
        self._place(_TIP, reference_from_tip)
        tracked, placed, turned_rad = _compare(*self._poses, robot.link_from_tip is not None)
        (x, y, z), (u, v, w) = tracked, placed
        self._mean.update((x - u, y - v, z - w), now)
        joints_ns = None if joints is None else joints.stamp.ns
        if joints_ns != self._joints_ns:
            self._joints_ns = joints_ns
            self._change.update(tracked, placed, self._mean.start, now.ns)
        off_mm = math.dist(tracked, placed)
        tip = reference_from_tip.source
        self._drift = RegistrationDrift(tip, off_mm, turned_rad, robot.max_drift)
        return self._drift

    def _place(self, number: int, pose: Transform) -> None:
        rotations, positions_mm = self._poses
        rotations[number], positions_mm[number] = pose.rotation, pose.translation_mm


_BASE, _LINK, _MOUNT, _TIP, _PLACED_LINK, _PLACED = range(6)
"""Numbers of the poses: the robot's root in the reference, the link there, the tip in the link; the
tip by the tracker; link and tip by the joints."""


@kernel
def _compare(
    rotations: FloatArray, positions_mm: FloatArray, is_mounted: bool
) -> tuple[Vector, Vector, float]:
    """The tip's positions in mm by tracker and joints, and the angle between the two in rad.

    ``rotations`` (6, 3, 3) and ``positions_mm`` (6, 3) are those of the six poses. Without a known
    mount, an identity, the link gives the tip's position and not its orientation.
    """
    _multiply(rotations, positions_mm, _BASE, _LINK, _PLACED_LINK)
    _multiply(rotations, positions_mm, _PLACED_LINK, _MOUNT, _PLACED)
    turned_rad = 0.0
    if is_mounted:
        turned_rad = length(turn_between(rotations[_PLACED], rotations[_TIP]))
    return row(positions_mm, _TIP), row(positions_mm, _PLACED), turned_rad


@kernel
def _multiply(
    rotations: FloatArray, positions_mm: FloatArray, first: int, second: int, product: int
) -> None:
    """Write pose ``first`` times pose ``second`` as pose ``product``, another one."""
    for j in range(3):
        axis = (rotations[second, 0, j], rotations[second, 1, j], rotations[second, 2, j])
        for i in range(3):
            rotations[product, i, j] = dot(row(rotations[first], i), axis)
    at = transform_point(rotations[first], positions_mm[first], row(positions_mm, second))
    _set(positions_mm[product], at)
