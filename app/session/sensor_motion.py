"""Motion of one sensor: the next pose is predicted, and a pose that it cannot reach is refused."""

import math
from collections import deque
from dataclasses import dataclass, fields

from app.geometry import NS_PER_MS, NS_PER_S, FloatArray, InputError, Transform


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


Vector = tuple[float, float, float]

ZERO: Vector = (0.0, 0.0, 0.0)


def distance_to_path(at: Vector, velocity: Vector, start_s: float, end_s: float) -> float:
    """Distance from ``at`` to the segment from ``velocity * start_s`` to ``velocity * end_s``."""
    x, y, z = at
    u, v, w = velocity
    square = u * u + v * v + w * w
    if square == 0.0:
        return math.sqrt(x * x + y * y + z * z)
    time_s = (x * u + y * v + z * w) / square
    if time_s < start_s:  # comparisons: `min` and `max` take longer than the rest
        time_s = start_s
    if time_s > end_s:
        time_s = end_s
    x, y, z = x - time_s * u, y - time_s * v, z - time_s * w
    return math.sqrt(x * x + y * y + z * z)


def rotation_vector(rotation: FloatArray) -> Vector:
    """Axis times angle in rad of a rotation (3, 3).

    The axis is unreliable within 1e-6 rad of half a turn, the angle is not.
    """
    (a, b, c), (d, e, f), (g, h, i) = rotation.tolist()
    x, y, z = h - f, c - g, d - b  # the axis times twice the sine
    twice_sine = math.sqrt(x * x + y * y + z * z)
    angle = math.atan2(twice_sine, a + e + i - 1.0)
    if twice_sine < 1e-9:
        return (angle, 0.0, 0.0)
    scale = angle / twice_sine
    return (x * scale, y * scale, z * scale)


SHARE = 1.0 / 32.0
"""Weight of a new difference: the noise is a mean over about 32 samples."""


class SensorNoise:
    """Standard deviation per axis, between ``min_sigma`` and ``max_sigma``, in any unit.

    It starts at ``max_sigma``, so that nothing is refused before the sensor is known. Motion that
    the prediction does not follow counts as noise too, up to ``max_sigma``: the gate is widest
    while the sensor is accelerated, and narrow where it rests.
    """

    def __init__(self, min_sigma: float, max_sigma: float) -> None:
        self._min, self._max = min_sigma * min_sigma, max_sigma * max_sigma
        self.variance = self._max
        """Variance of one axis."""

    def update(self, squared: float, factor: float) -> None:
        """Add a squared length of a difference whose variance is ``factor`` times the noise's."""
        variance = min(squared / (3.0 * factor), self._max)
        self.variance = max(self.variance + SHARE * (variance - self.variance), self._min)


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


@dataclass(slots=True)
class _Known:
    """A plausible pose, first measured at ``ns``; ``turned`` is the sum of all turns up to it."""

    ns: int
    position: Vector
    rotation: FloatArray
    turned: Vector


class SensorMotion:
    """Prediction of one sensor at constant velocity, with a gate around the predicted path.

    The velocity is that over the last `WINDOW_NS`, W, or over the last interval where samples are
    further apart. With an acceleration of at most ``a`` the sensor is within ``a t (t + W) / 2`` of
    the predicted path after the time ``t``. The gate adds `SIGMAS` of the prediction: the noise of
    three poses, learned by `SensorNoise`. The path begins at the last pose, because a tool that
    hits something stops at once, and is longer than ``t`` at both ends by `STAMP_ERROR_S`. No pose
    may be further from the last one than the largest speed allows. The same holds for rotation.

    Exact repetitions of a pose carry no motion: time counts from the first of them as far as the
    driver of this sensor is known to repeat poses while it moves.
    """

    def __init__(self, limits: MotionLimits) -> None:
        self.limits = limits
        self._noise_mm = SensorNoise(MIN_SIGMA_MM, MAX_SIGMA_MM)
        self._noise_rad = SensorNoise(MIN_SIGMA_RAD, MAX_SIGMA_RAD)
        self._known: deque[_Known] = deque()
        self._last_ns = 0
        self._repeat_ns = 0
        self._agreeing = CONSISTENT_SAMPLES
        self._refused_ns = 0
        self.jump: Jump | None = None

    @property
    def believed(self) -> bool:
        """False from a refused pose on until consecutive samples agree with each other again."""
        return self.jump is None

    def restart(self) -> None:
        """Forget all poses, after the source's clock has jumped back; the noise is kept."""
        self._known.clear()

    def update(self, pose: Transform, ns: int) -> bool:
        """Take the pose measured at ``ns``; return True if it may be used."""
        x, y, z = pose.translation_mm.tolist()
        if not self._known or ns - self._last_ns > FORGET_NS:
            self._begin((x, y, z), pose.rotation, ns)
            return self._count(ns)
        last = self._known[-1]
        turn_matrix = last.rotation.T.dot(pose.rotation)
        a, b, c = last.position
        moved = (x - a, y - b, z - c)
        if moved == ZERO and (last.rotation == pose.rotation).all():
            self._last_ns = max(self._last_ns, ns)
            return self._count(ns)
        turn = rotation_vector(turn_matrix)
        jump = self._gate(moved, turn, ns)
        if jump is not None:
            self.jump = jump
            self._refused_ns, self._agreeing = ns, 0
            self._begin((x, y, z), pose.rotation, ns)
            return False
        u, v, w = last.turned
        turned = (u + turn[0], v + turn[1], w + turn[2])
        self._known.append(_Known(max(ns, last.ns), (x, y, z), pose.rotation, turned))
        while len(self._known) > 2 and self._known[1].ns <= self._known[-1].ns - WINDOW_NS:
            self._known.popleft()
        self._last_ns = max(self._last_ns, ns)
        return self._count(ns)

    def _begin(self, position: Vector, rotation: FloatArray, ns: int) -> None:
        self._known.clear()
        self._known.append(_Known(ns, position, rotation, ZERO))
        self._last_ns = ns

    def _count(self, ns: int) -> bool:
        """Count a pose that agrees with the last; True once the sensor is believed."""
        if self.jump is not None:
            self._agreeing += 1
            if self._agreeing >= CONSISTENT_SAMPLES and ns - self._refused_ns >= CONSISTENT_NS:
                self.jump = None
        return self.jump is None

    def _gate(self, moved: Vector, turn: Vector, ns: int) -> Jump | None:
        """The jump by ``moved`` and ``turn`` from the last pose, None if it is plausible."""
        first, last = self._known[0], self._known[-1]
        limits = self.limits
        # Comparisons instead of `min` and `max`, which take a tenth of the time of a check.
        silent_ns = ns - self._last_ns if ns > self._last_ns else 0
        since_ns = ns - last.ns if ns > last.ns else 0
        # A pose that a driver repeats belongs to the first of its repetitions.
        if since_ns > silent_ns + MAX_REPEAT_NS:
            since_ns = silent_ns + MAX_REPEAT_NS
        gap_ns = silent_ns + self._repeat_ns
        if gap_ns > since_ns:
            gap_ns = since_ns
        gap_s, since_s = gap_ns / NS_PER_S, since_ns / NS_PER_S
        window_s = (last.ns - first.ns) / NS_PER_S
        if window_s > 0.0:
            a, b, c = first.position
            x, y, z = last.position
            velocity = ((x - a) / window_s, (y - b) / window_s, (z - c) / window_s)
            a, b, c = first.turned
            x, y, z = last.turned
            rate = ((x - a) / window_s, (y - b) / window_s, (z - c) / window_s)
            ratio = gap_s / window_s
            factor = 1.0 + (1.0 + ratio) ** 2 + ratio * ratio
            reach_s2 = 0.5 * gap_s * (gap_s + window_s)
            gap = (since_s, STAMP_ERROR_S * (1.0 + ratio), factor, gap_ns)
            jump = self._off(
                moved, velocity, limits.acceleration_mm_s2 * reach_s2, self._noise_mm, *gap
            ) or self._off(turn, rate, limits.acceleration_rad_s2 * reach_s2, self._noise_rad, *gap)
            if jump is not None:
                return jump
            if since_ns > silent_ns:
                self._learn_repeat(velocity, since_ns)
        way_s = gap_s + STAMP_ERROR_S
        return _too_fast(
            moved, limits.speed_mm_s * way_s, self._noise_mm, gap_ns, turned=False
        ) or _too_fast(turn, limits.speed_rad_s * way_s, self._noise_rad, gap_ns, turned=True)

    def _off(
        self,
        way: Vector,
        velocity: Vector,
        reach: float,
        noise: SensorNoise,
        since_s: float,
        error_s: float,
        factor: float,
        gap_ns: int,
    ) -> Jump | None:
        """The jump if ``way`` is further than allowed from the predicted path; else learn noise."""
        turned = noise is self._noise_rad
        u, v, w = velocity
        bend = BEND * STAMP_ERROR_S * math.sqrt(u * u + v * v + w * w)
        allowed = reach + bend + SIGMAS * math.sqrt(noise.variance * factor)
        off = distance_to_path(way, velocity, -error_s, since_s + error_s)
        if off > allowed and not (turned and allowed >= math.pi):
            return Jump(off, allowed, gap_ns, turned)
        if since_s > gap_ns / NS_PER_S:
            return None  # repeated poses do not show the noise
        x, y, z = way
        x, y, z = x - since_s * u, y - since_s * v, z - since_s * w
        noise.update(x * x + y * y + z * z, factor)
        return None

    def _learn_repeat(self, velocity: Vector, since_ns: int) -> None:
        """Remember for how long the driver has repeated a pose of a sensor that moves."""
        u, v, w = velocity
        if u * u + v * v + w * w > MOVING_MM_S * MOVING_MM_S:
            self._repeat_ns = max(self._repeat_ns, min(since_ns, MAX_REPEAT_NS))


def _too_fast(
    way: Vector, allowed: float, noise: SensorNoise, gap_ns: int, *, turned: bool
) -> Jump | None:
    x, y, z = way
    off = math.sqrt(x * x + y * y + z * z)
    allowed += SIGMAS * math.sqrt(2.0 * noise.variance)
    if off <= allowed or (turned and allowed >= math.pi):
        return None
    return Jump(off, allowed, gap_ns, turned)
