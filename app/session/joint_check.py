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
    length,
    point_distance,
    row,
    sub,
    turn_between,
)
from app.geometry import NS_PER_S, FloatArray, Stamp, Transform
from app.registration import RegistrationDrift
from app.robot.kinematic_tree import LinkPoses
from app.session import relations, repetition, sensor_motion, tracked_edges
from app.session.relations import ENDS_AFTER_NS
from app.session.repetition import copy_pose
from app.session.sensor_motion import (
    MAX_POSES,
    MAX_SIGMA_MM,
    MIN_SIGMA_MM,
    MOVING_MM_S,
    SIGMAS,
    STAMP_ERROR_S,
    WINDOW_NS,
    Record,
    State,
    drop_first,
    learned_variance,
)
from app.session.setup import RobotSetup
from app.session.tracked_edges import multiply_pose

MEAN_S = 0.25
"""Time constant of the mean. It removes the jitter of the tracker, so that a difference that stays
is found below the bound of a single one; a constant error of velocity v appears as v times this."""

SHARE_OF_BOUND = 0.5
"""Default limit, as a share of the bound of a single difference. In the simulated case, with a
registration error, breath and jitter, the mean reaches a quarter of the bound of 5 mm."""

START_NS = NS_PER_S
"""Time after the first difference from which the mean's start is fixed: four time constants."""


_NONE: Vector = (0.0, 0.0, 0.0)

MEAN_DRIFT = np.dtype(
    [
        ("limit_mm", np.float64),
        ("exceeded", np.bool_),  # True if the mean has left its limit
        ("known", np.bool_),  # True from the first difference on
        ("mean", np.float64, 3),
        ("start", np.float64, 3),  # the mean at its start
        ("first_ns", np.int64),
        ("last_ns", np.int64),
        ("elapsed_ns", np.int64),  # time measured before the clock was set back
    ],
    align=True,
)
"""Mean of differences (3,) in mm, tracked minus predicted, with exponential weights.

It is exceeded if both the mean and its change since the start are longer than ``limit_mm``: the
error of an accepted registration, which is there from the start, is no drift. An error that grows
at ``r`` mm/s from 0 is found before it is ``limit_mm + r * MEAN_S``, and from a constant error of
``e`` mm before ``limit_mm + e + r * MEAN_S``.
"""


def mean_text(s: Record) -> str:
    """The mean and its limit."""
    return (
        f"the tool is {math.hypot(*s['mean'].tolist()):.3g} mm from its position by the joints in "
        f"the mean; expected at most {s['limit_mm']:g} mm"
    )


@kernel
def update_mean(s: Record, difference: Vector, ns: int) -> None:
    """Add a difference in mm, measured at ``ns``."""
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
    s["exceeded"] = length(mean) > limit_mm and changed_mm > limit_mm


GAP_NS = NS_PER_S // 4
"""Differences that are further apart are not compared: the error of a registration changes with the
place of the tool."""

SUDDEN_CHANGE = np.dtype(
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
"""A change of the difference, found within two differences, whatever the registration's error.

The mean of the last two is compared with the mean before them, which has exponential weights with
the time constant `MEAN_S`. It may be ``limit_mm`` off or, if that is more, `SIGMAS` standard
deviations, learned by `learned_variance`, plus `STAMP_ERROR_S` times the change of the velocity: an
error of the joints' clock appears as a difference when the tool begins to move.

The finding ends when for `ENDS_AFTER_NS` the difference has been as near to its mean before the
change, or to that of the session's start.
"""


def change_text(s: Record) -> str:
    """The change and its limit."""
    return (
        f"the tool moves by {s['off_mm']:.3g} mm against its position by the joints within "
        f"two samples; expected at most {s['allowed_mm']:.3g} mm"
    )


@kernel
def update_change(
    s: Record, tracked: Vector, predicted: Vector, start: FloatArray, ns: int
) -> None:
    """Add the tip's positions in mm at ``ns``, after new joints.

    ``start`` (3,) is the difference at the session's start. A pose that a driver repeats while the
    tool moves is not used.
    """
    if s["count"] > 0 and not 0 <= ns - s["ns"][s["count"] - 1] <= GAP_NS:
        s["count"] = 0
    if s["count"] > 0 and _is_repeated(s, tracked, predicted, ns):
        return
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
        return
    before = sub(row(s["at"][new - 1], 0), row(s["at"][new - 1], 1))
    two, mean = _between(before, difference, 0.5), _vector(s["mean"])
    off_mm = point_distance(two, mean)
    if s["found"]:
        _end(s, min(off_mm, point_distance(two, _vector(start))), ns)
        return
    x, y, z = sub(predicted, row(s["at"][0], 1))
    seconds = (ns - s["ns"][0]) / NS_PER_S
    velocity, mean_velocity = (x / seconds, y / seconds, z / seconds), _vector(s["velocity"])
    noise_mm = SIGMAS * math.sqrt(s["variance"])
    lag_mm = STAMP_ERROR_S * point_distance(velocity, mean_velocity)
    s["allowed_mm"] = max(s["limit_mm"], noise_mm + lag_mm)
    if off_mm > s["allowed_mm"]:
        s["found"], s["off_mm"], s["near"] = True, off_mm, False
        return
    s["variance"] = learned_variance(
        s["variance"], off_mm * off_mm, 1.0, MIN_SIGMA_MM, MAX_SIGMA_MM
    )
    s["samples"] += 1
    share = max(_share(ns - s["ns"][new - 1]), 1.0 / s["samples"])
    _set(s["mean"], _between(mean, before, share))
    _set(s["velocity"], _between(mean_velocity, velocity, share))


@kernel
def _is_repeated(s: Record, tracked: Vector, predicted: Vector, ns: int) -> bool:
    """True for the same time, or the same tracked position although the joints move."""
    last = s["count"] - 1
    since_ns = ns - s["ns"][last]
    moved_mm = point_distance(predicted, row(s["at"][last], 1))
    moves = moved_mm * NS_PER_S > MOVING_MM_S * since_ns
    return since_ns == 0 or (moves and tracked == row(s["at"][last], 0))


@kernel
def _end(s: Record, off_mm: float, ns: int) -> None:
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


_BASE, _LINK, _MOUNT, _TIP, _PLACED, _POSES = range(6)
"""Numbers of the poses: the robot's root in the reference, the link there, the tip in the link; the
tip in the reference by the tracker and by the joints. Then their number."""

_JOINTS = np.dtype(
    [
        ("rotation", np.float64, (_POSES, 3, 3)),
        ("position", np.float64, (_POSES, 3)),  # in mm
        ("is_mounted", np.bool_),  # False for an unknown orientation of the tip in the link
        ("mean", MEAN_DRIFT),
        ("change", SUDDEN_CHANGE),
    ],
    align=True,
)


class JointCheck:
    """Compares the tracked tip with its prediction by joints and registration.

    ``mean_mm`` is the limit of the mean and of a sudden change; None takes `SHARE_OF_BOUND` of the
    bound of a single difference.
    """

    def __init__(self, robot: RobotSetup | None, mean_mm: float | None) -> None:
        self._robot = robot
        self.is_configured = bool(robot and robot.registration and not robot.follows_tool)
        """True if the robot has joints and a registration: it can contradict the tracker."""
        # Run the kernel once, so that the first step does not wait for the compiler.
        _update(np.zeros(1, _JOINTS), True, 0)
        self._state: State = np.zeros(1, _JOINTS)
        state, nothing = self._state[0], Transform.identity("frame", "frame")
        self._rotations, self._positions_mm = state["rotation"], state["position"]
        registration = None if robot is None else robot.registration
        mount = None if robot is None else robot.link_from_tip
        self._place(_BASE, nothing if registration is None else registration.transform)
        self._place(_MOUNT, mount or nothing)
        state["is_mounted"] = mount is not None
        bound_mm = 1.0 if robot is None else robot.max_drift.translation_mm
        limit_mm = SHARE_OF_BOUND * bound_mm if mean_mm is None else mean_mm
        state["mean"]["limit_mm"] = state["change"]["limit_mm"] = limit_mm
        state["change"]["variance"] = MAX_SIGMA_MM**2
        self._joints_ns: int | None = None
        self._drift: RegistrationDrift | None = None
        self._has_drifted = False
        self.is_silent = False
        """True if the configured joints are not known now: nothing checks the tracker."""

    def drifts(self) -> dict[str, str]:
        """The single difference, mean and change that are beyond their limits: one line each.

        A drift does not end when the joint states stop.
        """
        drifts = {}
        if self._drift is not None and not self._drift.accepted:
            drifts["single"] = self._drift.reason
        if self._has_drifted:
            state = self._state[0]
            if state["mean"]["exceeded"]:
                drifts["mean"] = mean_text(state["mean"])
            if state["change"]["found"]:
                drifts["change"] = change_text(state["change"])
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
        robot, tip = self._robot, reference_from_tip
        if robot is None or not self.is_configured or not links or tip is None:
            return None
        joints_ns = None if joints is None else joints.stamp.ns
        is_new, self._joints_ns = joints_ns != self._joints_ns, joints_ns
        link = LinkPoses.of(links).matrix(robot.tool_link)
        self._rotations[_LINK], self._positions_mm[_LINK] = link[:3, :3], link[:3, 3]
        self._place(_TIP, tip)
        off_mm, turned_rad, self._has_drifted = _update(self._state, is_new, now.ns)
        self._drift = RegistrationDrift(tip.source, off_mm, turned_rad, robot.max_drift)
        return self._drift

    def _place(self, number: int, pose: Transform) -> None:
        self._rotations[number], self._positions_mm[number] = pose.rotation, pose.translation_mm


@kernel
def _update(state: State, is_new: bool, now_ns: int) -> tuple[float, float, bool]:
    """Update a record (1,) in which link and tip were placed; ``is_new`` for new joints.

    Returns the distance of the tip from its prediction in mm, the angle between the two in rad, and
    True if one of the other limits is exceeded. Without a known mount, an identity, the link gives
    the tip's position and not its orientation: the angle is 0.
    """
    s = state[0]
    rotations, positions = s["rotation"], s["position"]
    placed, placed_mm = rotations[_PLACED], positions[_PLACED]
    copy_pose(rotations[_BASE], positions[_BASE], placed, placed_mm)
    for k in (_LINK, _MOUNT):
        multiply_pose(placed, placed_mm, rotations[k], positions[k], False)
    turned_rad = length(turn_between(placed, rotations[_TIP])) if s["is_mounted"] else 0.0
    tracked, predicted = row(positions, _TIP), row(positions, _PLACED)
    update_mean(s["mean"], sub(tracked, predicted), now_ns)
    if is_new:
        update_change(s["change"], tracked, predicted, s["mean"]["start"], now_ns)
    has_drifted = bool(s["mean"]["exceeded"] or s["change"]["found"])
    return point_distance(tracked, predicted), turned_rad, has_drifted


renew_with(_end, relations.__file__)
renew_with(update_change, sensor_motion.__file__, relations.__file__)
renew_with(
    _update,
    sensor_motion.__file__,
    relations.__file__,
    repetition.__file__,
    tracked_edges.__file__,
)
