"""Motion of one sensor: the next pose is predicted, and a pose that it cannot reach is refused."""

import math
from dataclasses import astuple, dataclass, fields
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from app.fixture.jit import inlined, kernel
from app.fixture.vectors import Vector, add, add_scaled, dot, length, row, sub, turn_between
from app.geometry import NS_PER_MS, NS_PER_S, FloatArray, InputError


@dataclass(frozen=True, slots=True)
class MotionLimits:
    """Largest speed and acceleration, in mm and rad, at which a pose is still plausible.

    The defaults are those of a swing by hand at 2 Hz with amplitudes of 100 mm and 90 degrees:
    1257 mm/s and 15.8 m/s2, 1131 degrees/s and 14 200 degrees/s2. 98.9 % of the power of voluntary
    movements of surgeons is below 2 Hz (Riviere, Rader and Khosla, "Characteristics of hand motion
    of eye surgeons", 1997). The fastest motion in the public recording of a pointer that is moved
    from landmark to landmark is 683 mm/s, 4.8 m/s2, 639 degrees/s and 6900 degrees/s2. The speed is
    1.6 times that of the swing, because a sensor sits on a lever. A sensor on the patient has the
    same limits: a patient or a phantom is moved by hands. Raises `InputError` for a value that is
    not a finite number above 0.
    """

    speed_mm_s: float = 2_000.0
    acceleration_mm_s2: float = 16_000.0
    speed_rad_s: float = math.radians(1_200.0)
    acceleration_rad_s2: float = math.radians(15_000.0)

    def __post_init__(self) -> None:
        for each in fields(self):
            value = getattr(self, each.name)
            if not (math.isfinite(value) and value > 0.0):
                raise InputError(
                    f"{each.name} of the motion limits is {value}; expected a finite number above 0"
                )


@kernel
def distance_to_path(at: Vector, velocity: Vector, start_s: float, end_s: float) -> float:
    """Distance from ``at`` to the segment from ``velocity * start_s`` to ``velocity * end_s``."""
    square = dot(velocity, velocity)
    time_s = min(max(dot(at, velocity) / square, start_s), end_s) if square > 0.0 else 0.0
    return float(length(add_scaled(at, -time_s, velocity)))


SHARE = 1.0 / 32.0
"""Weight of a new difference: the noise is a mean over about 32 samples."""


@inlined
def learned_variance(
    variance: float, squared: float, factor: float, min_sigma: float, max_sigma: float
) -> float:
    """Variance of one axis after a difference of length^2 ``squared`` and ``factor`` its variance.

    It is that of a noise between ``min_sigma`` and ``max_sigma``, in any unit, and starts at the
    largest, so that nothing is refused before the sensor is known. Motion that the prediction does
    not follow counts as noise too: the gate is widest while the sensor is accelerated, and narrow
    where it rests.
    """
    new = min(squared / (3.0 * factor), max_sigma * max_sigma)
    return max(variance + SHARE * (new - variance), min_sigma * min_sigma)


SIGMAS = 6.0
"""Standard deviations of the prediction that count as noise. Beyond 6 along one of three axes are
2e-9 of normally distributed samples: fewer than one in a year of three sensors at 5 Hz, and one in
some hundred hours at 1 kHz."""

WINDOW_NS = 20 * NS_PER_MS
"""Shortest time over which a velocity is computed. Longer, and the acceleration within it would
widen the gate more than the noise does; shorter, and it would be the other way round."""

STAMP_ERROR_S = 0.020
"""Error of the interval between two stamps: drivers stamp on arrival, in bursts."""

BEND = 0.25
"""Sine of the angle by which a path bends within `STAMP_ERROR_S`."""

MAX_REPEAT_NS = 50 * NS_PER_MS
"""Longest time for which a driver repeats the last pose of a slower sensor that moves."""

MOVING_MM_S = 30.0
"""Speed above which an exact repetition is a driver's, and not a sensor at rest."""

FORGET_NS = NS_PER_S
"""Gap after which the last pose says nothing about the next: a hand is anywhere by then."""

CONSISTENT_SAMPLES = 5
CONSISTENT_NS = 100 * NS_PER_MS
"""After a refused pose the sensor is believed again once as many consecutive samples agree with
each other, over at least this time."""

MIN_SIGMA_MM, MAX_SIGMA_MM = 0.1, 1.0
MIN_SIGMA_RAD, MAX_SIGMA_RAD = math.radians(0.1), math.radians(1.5)
_MIN_SIGMA, _MAX_SIGMA = (MIN_SIGMA_MM, MIN_SIGMA_RAD), (MAX_SIGMA_MM, MAX_SIGMA_RAD)
"""Bounds of the learned noise per axis. EM tracking in an undistorted field has 0.2 mm and
0.2 degrees. The upper bounds keep a noisy sensor from hiding a jump."""


@dataclass(frozen=True, slots=True)
class Jump:
    """A pose that its sensor cannot have reached: how far it is from where it can be.

    ``off`` is the distance from the predicted path, ``allowed`` the largest plausible one, both in
    mm or, if ``turned``, in rad. ``gap_ns`` is the time since the last plausible pose.
    """

    off: float
    allowed: float
    gap_ns: int
    turned: bool

    @property
    def text(self) -> str:
        """Text of the measured motion and the allowed one, in mm or degrees."""
        scale, unit = (180.0 / math.pi, " degrees") if self.turned else (1.0, " mm")
        return (
            f"{'turns' if self.turned else 'jumps'} by {self.off * scale:.3g}{unit} within "
            f"{self.gap_ns / NS_PER_MS:.3g} ms; expected at most {self.allowed * scale:.3g}{unit}"
        )


MAX_POSES = 128
"""Poses within `WINDOW_NS` that are kept: at rates above 6 kHz the window is shorter."""

State: TypeAlias = NDArray[np.void]
"""An array of records, and in a kernel one of them."""

Record: TypeAlias = Any
"""One record: its fields are numbers and arrays."""

SENSOR_MOTION = np.dtype(
    [
        ("count", np.int64),  # of the plausible poses that are kept: the last one, the others for
        ("ns", np.int64, MAX_POSES),  # its velocity. When each was first measured,
        ("at", np.float64, (MAX_POSES, 2, 3)),  # where in mm, and the sum of all turns in rad
        ("rotation", np.float64, (3, 3)),  # of the last one
        ("last_ns", np.int64),  # when it was last measured
        ("repeat_ns", np.int64),  # for how long the driver repeats a pose of a sensor that moves
        ("variance", np.float64, 2),  # in mm^2 and rad^2
        ("limits", np.float64, 4),  # `MotionLimits`
        ("refused", np.bool_),  # True until consecutive samples agree with each other again
        ("refused_ns", np.int64),
        ("agreeing", np.int64),
        ("jump", np.float64, 4),  # `Jump`: the last refused pose
    ],
    align=True,
)
"""Prediction of one sensor at constant velocity, with a gate around the predicted path.

The velocity is that over the last `WINDOW_NS`, W, or over the last interval where samples are
further apart. With an acceleration of at most ``a`` the sensor is within ``a t (t + W) / 2`` of
the predicted path after the time ``t``. The gate adds `SIGMAS` of the prediction: the noise of
three poses, learned by `learned_variance`. The path begins at the last pose, because a tool
that hits something stops at once, and is longer than ``t`` at both ends by `STAMP_ERROR_S`. No
pose may be further from the last one than the largest speed allows. The same holds for
rotation.

Exact repetitions of a pose carry no motion: time counts from the first of them as far as the
driver of this sensor is known to repeat poses while it moves.
"""


def begin_motion(sensors: State, limits: MotionLimits) -> None:
    """Begin records (n,) of sensors of which nothing is known."""
    sensors["variance"], sensors["limits"] = np.square(_MAX_SIGMA), astuple(limits)


def restart_motion(sensors: State) -> None:
    """Forget all poses, after the source's clock has jumped back; the noise is kept."""
    sensors["count"] = 0


def jump_of(sensor: Record) -> Jump | None:
    """The last refused pose while the sensor, a record, is not believed."""
    if not sensor["refused"]:
        return None
    off, allowed, gap_ns, turned = sensor["jump"].tolist()
    return Jump(off, allowed, int(gap_ns), bool(turned))


@kernel
def update_motion(s: Record, rotation: FloatArray, position: FloatArray, ns: int) -> bool:
    """Take the pose measured at ``ns``; return True if it may be used.

    ``rotation`` is (3, 3), ``position`` (3,) in mm. After a refused pose none may be used until
    consecutive samples agree with each other again.
    """
    place = (position[0], position[1], position[2])
    last = s["count"] - 1
    if last < 0 or ns - s["last_ns"] > FORGET_NS:
        _begin(s, rotation, place, ns)
        return _is_believed(s, ns)
    moved = sub(place, row(s["at"][last], 0))
    if moved != _NONE or not is_same_rotation(s["rotation"], rotation):
        turn = turn_between(s["rotation"], rotation)
        if not _is_plausible(s, moved, turn, ns):
            s["refused"], s["refused_ns"], s["agreeing"] = True, ns, 0
            _begin(s, rotation, place, ns)
            return False
        first_ns = max(ns, s["ns"][last])
        _append(s, rotation, place, add(row(s["at"][last], 1), turn), first_ns)
        while s["count"] > 2 and s["ns"][1] <= first_ns - WINDOW_NS:
            drop_first(s)
    s["last_ns"] = max(s["last_ns"], ns)
    return _is_believed(s, ns)


_NONE: Vector = (0.0, 0.0, 0.0)


@inlined
def is_same_rotation(first: FloatArray, second: FloatArray) -> bool:
    """True if all digits of two rotations (3, 3) are the same."""
    same = True
    for i in range(3):
        for j in range(3):
            same &= first[i, j] == second[i, j]
    return same


@kernel
def _begin(s: State, rotation: FloatArray, place: Vector, ns: int) -> None:
    s["count"], s["last_ns"] = 0, ns
    _append(s, rotation, place, _NONE, ns)


@kernel
def _append(s: State, rotation: FloatArray, place: Vector, turned: Vector, ns: int) -> None:
    if s["count"] == MAX_POSES:
        drop_first(s)
    new = s["count"]
    s["count"], s["ns"][new] = new + 1, ns
    for i in range(3):
        s["at"][new, 0, i], s["at"][new, 1, i] = place[i], turned[i]
        for j in range(3):
            s["rotation"][i, j] = rotation[i, j]


@kernel
def drop_first(s: State) -> None:
    """Drop the first of the ``count`` values of ``ns`` and ``at`` (n, 2, 3)."""
    s["count"] -= 1
    for k in range(s["count"]):
        s["ns"][k] = s["ns"][k + 1]
        for i in range(3):
            s["at"][k, 0, i], s["at"][k, 1, i] = s["at"][k + 1, 0, i], s["at"][k + 1, 1, i]


@kernel
def _is_believed(s: State, ns: int) -> bool:
    """Count a pose that agrees with the last; True once the sensor is believed."""
    if s["refused"]:
        s["agreeing"] += 1
        if s["agreeing"] >= CONSISTENT_SAMPLES and ns - s["refused_ns"] >= CONSISTENT_NS:
            s["refused"] = False
    return not s["refused"]


@kernel
def _is_plausible(s: State, moved: Vector, turn: Vector, ns: int) -> bool:
    """True if the sensor can be ``moved`` mm from its last pose, and turned by ``turn`` in rad."""
    last = s["count"] - 1
    silent_ns, since_ns = max(int(ns - s["last_ns"]), 0), max(int(ns - s["ns"][last]), 0)
    # A pose that a driver repeats belongs to the first of its repetitions.
    since_ns = min(since_ns, silent_ns + MAX_REPEAT_NS)
    gap_ns = min(silent_ns + int(s["repeat_ns"]), since_ns)
    if s["ns"][last] > s["ns"][0]:
        if not (
            _is_near_path(s, 0, moved, since_ns, gap_ns)
            and _is_near_path(s, 1, turn, since_ns, gap_ns)
        ):
            return False
        if since_ns > silent_ns and length(_velocity(s, 0)) > MOVING_MM_S:
            s["repeat_ns"] = max(s["repeat_ns"], min(since_ns, MAX_REPEAT_NS))
    return _is_slow_enough(s, 0, moved, gap_ns) and _is_slow_enough(s, 1, turn, gap_ns)


@inlined
def _velocity(s: State, kind: int) -> Vector:
    """Mean velocity over the kept poses in mm/s; in rad/s if ``kind`` is 1, not 0, as below."""
    last = s["count"] - 1
    x, y, z = sub(row(s["at"][last], kind), row(s["at"][0], kind))
    seconds = (s["ns"][last] - s["ns"][0]) / NS_PER_S
    return (x / seconds, y / seconds, z / seconds)


@kernel
def _is_near_path(s: State, kind: int, way: Vector, since_ns: int, gap_ns: int) -> bool:
    """True if ``way`` ends near the predicted path; the noise is then learned."""
    velocity = _velocity(s, kind)
    window_s = (s["ns"][s["count"] - 1] - s["ns"][0]) / NS_PER_S
    since_s, gap_s = since_ns / NS_PER_S, gap_ns / NS_PER_S
    ratio = gap_s / window_s
    factor = 1.0 + (1.0 + ratio) ** 2 + ratio * ratio
    reach = s["limits"][2 * kind + 1] * (0.5 * gap_s * (gap_s + window_s))
    bend = BEND * STAMP_ERROR_S * length(velocity)
    allowed = reach + bend + SIGMAS * math.sqrt(s["variance"][kind] * factor)
    error_s = STAMP_ERROR_S * (1.0 + ratio)
    off = distance_to_path(way, velocity, -error_s, since_s + error_s)
    if not _is_allowed(s, kind, off, allowed, gap_ns):
        return False
    if since_ns == gap_ns:  # repeated poses do not show the noise
        error = add_scaled(way, -since_s, velocity)
        s["variance"][kind] = learned_variance(
            s["variance"][kind], dot(error, error), factor, _MIN_SIGMA[kind], _MAX_SIGMA[kind]
        )
    return True


@kernel
def _is_slow_enough(s: State, kind: int, way: Vector, gap_ns: int) -> bool:
    allowed = s["limits"][2 * kind] * (gap_ns / NS_PER_S + STAMP_ERROR_S)
    allowed += SIGMAS * math.sqrt(2.0 * s["variance"][kind])
    return _is_allowed(s, kind, length(way), allowed, gap_ns)


@kernel
def _is_allowed(s: State, kind: int, off: float, allowed: float, gap_ns: int) -> bool:
    """True unless ``off`` is beyond ``allowed``, which is then the jump."""
    if off <= allowed or (kind == 1 and allowed >= math.pi):
        return True
    s["jump"][0], s["jump"][1], s["jump"][2], s["jump"][3] = off, allowed, gap_ns, kind
    return False
