"""Read a plan of ``marginguard plan approach`` and follow its timed path at a variable rate.

Never off the path, within the limits of the joints.
"""

import math
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicHermiteSpline

from app.files.bounded_io import read_bounded
from app.files.json_file import parse_json
from app.geometry import NS_PER_S, FloatArray, InputError

MAX_STOP_S = 0.5
"""A faster motion, which could not stop in this time, is slowed down to it."""

_MAX_STEP_NS = 20_000_000
"""A step that comes later moves the arm as far as this one."""

_ROUNDING_S = 1e-9

_ASIDE = 1e-6
"""Largest velocity, rad/s or m/s, across the line to the next sample, and back along it."""

_LARGEST = 1e9
_ROUNDED = 1.001

_MAX_EXCESS = 2.0
"""Samples of a jerk-limited motion are joined by at most 1.5 times its acceleration."""


@dataclass(frozen=True, slots=True, eq=False)
class PlannedMotion:
    """A path of ``joints`` from rest to rest, straight between samples, as it was planned.

    ``times_ns`` (k,) from 0, ``positions`` and ``velocities`` (k, d), in rad, for sliding joints in
    m. ``held`` are the positions of all other joints, ``accelerations`` (d,) the limits of
    ``joints``, ``setup_id`` that of the guard when it was planned; empty if none was asked.
    ``robot`` is the name of the robot. Copied and read-only.

    ``fastest`` (d,) are the largest speeds, also between samples, where the positions are cubic.

    Raises `InputError` for other shapes and numbers, and for a motion that is not at rest where its
    direction changes, or that does not join its samples within its accelerations.
    """

    robot: str
    joints: tuple[str, ...]
    held: Mapping[str, float]
    times_ns: NDArray[np.int64]
    positions: FloatArray
    velocities: FloatArray
    accelerations: FloatArray
    setup_id: str
    fastest: FloatArray = field(init=False)

    def __post_init__(self) -> None:
        for name in ("times_ns", "positions", "velocities", "accelerations"):
            array = np.array(getattr(self, name))
            array.flags.writeable = False
            object.__setattr__(self, name, array)
        shape = self.times_ns.size, len(self.joints)
        arrays = self.positions, self.velocities, self.accelerations
        shapes_found = [each.shape for each in (self.times_ns, *arrays)]
        if shapes_found != [shape[:1], shape, shape, shape[1:]] or 0 in shape:
            shapes = ", ".join(str(each.shape) for each in arrays)
            raise InputError(f"plan: has arrays {shapes}; expected {shape} twice, and {shape[1:]}")
        numbers = *arrays, list(self.held.values())
        if not all((np.abs(each) <= _LARGEST).all() for each in numbers):  # also for NaN
            raise InputError(f"plan: has NaN or more than {_LARGEST:g}; expected smaller ones")
        if self.times_ns[0] != 0 or (np.diff(self.times_ns) <= 0).any():
            raise InputError("plan: its times do not increase from 0; expected increasing ones")
        if set(self.joints) & set(self.held) or len(set(self.joints)) != shape[1]:
            raise InputError("plan: names a joint twice; expected each joint once")
        if not (self.accelerations > 0.0).all():
            raise InputError("plan: has a limit of 0 or less; expected limits above 0")
        lengths, lines = lines_of(self.positions)
        if not keeps_to_lines(self.velocities, lines):
            raise InputError("plan: moves off the lines of its samples; expected rest at turns")
        if self.velocities[[0, -1]].any():
            raise InputError("plan: begins or ends in motion; expected rest")
        self._check_between(lengths, lines)

    def _check_between(self, lengths: FloatArray, lines: FloatArray) -> None:
        """Set ``fastest``, and check the motion between samples.

        The speed there is a polynomial of degree 2 with the Bernstein coefficients ``start``,
        ``middle`` and ``end``, which contain it; the middle one is not reached.
        """
        spans_s = np.diff(self.times_ns)[:, None] / NS_PER_S
        start = (self.velocities[:-1] * lines).sum(axis=1, keepdims=True)
        end = (self.velocities[1:] * lines).sum(axis=1, keepdims=True)
        middle = 3.0 * lengths / spans_s - start - end
        if middle.min(initial=0.0) < -_ASIDE:
            raise InputError("plan: moves back between its samples; expected slower samples")
        changes = 2.0 * np.maximum(np.abs(middle - start), np.abs(end - middle)) / spans_s
        means = np.abs(np.diff(self.velocities, axis=0)) / spans_s
        if (means > _ROUNDED * self.accelerations).any() or (
            changes * np.abs(lines) > _MAX_EXCESS * self.accelerations
        ).any():
            raise InputError(
                "plan: exceeds its accelerations between samples; expected times that allow them"
            )
        peak = np.maximum(start, end)
        above = np.maximum(middle - peak, 0.0)
        bend = np.maximum(2.0 * middle - start - end, above)
        peak += np.divide(above * above, bend, out=np.zeros_like(above), where=above > 0.0)
        fastest = (peak * np.abs(lines)).max(axis=0, initial=0.0)
        fastest.flags.writeable = False
        object.__setattr__(self, "fastest", fastest)


def lines_of(positions: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Lengths (k - 1, 1) of the lines between ``positions`` (k, d), and directions (k - 1, d)."""
    steps = np.diff(positions, axis=0)
    lengths = np.linalg.norm(steps, axis=1, keepdims=True)
    return lengths, np.divide(steps, lengths, out=np.zeros_like(steps), where=lengths > 0.0)


def keeps_to_lines(velocities: FloatArray, lines: FloatArray) -> bool:
    """True if ``velocities`` (k, d) are along ``lines`` (k - 1, d) of `lines_of`, 0 at turns."""
    for ends in (velocities[:-1], velocities[1:]):
        along = np.maximum((ends * lines).sum(axis=1, keepdims=True), 0.0)
        if not np.abs(ends - along * lines).max(initial=0.0) <= _ASIDE:
            return False
    return True


class PathFollower:
    """The place on the path of ``motion``, which `step` moves on; the rate 1 is that of the plan.

    Pure. A rate between 0 and 1 slows the motion down in time, so that the joints stay on the path;
    it changes as fast as the accelerations of the plan allow. ``max_speed`` (d,) is that of the
    joints, which the motion may exceed between its samples.
    """

    def __init__(self, motion: PlannedMotion, max_speed: FloatArray | float = math.inf) -> None:
        times_s = motion.times_ns / NS_PER_S
        self._accelerations, self._end_s = motion.accelerations, float(times_s[-1])
        self._last: FloatArray = motion.positions[-1]
        self._path = None
        if len(times_s) > 1:
            self._path = CubicHermiteSpline(times_s, motion.positions, motion.velocities)
        self._rests_s = times_s[~motion.velocities.any(axis=1)]
        stop_s = float((motion.fastest / motion.accelerations).max())
        excess = float((motion.fastest / max_speed).max())
        self._max_rate = 1.0 / max(1.0, excess, stop_s / MAX_STOP_S)
        self.stop_s = stop_s * self._max_rate
        """Longest time in which the joints can stop."""
        self._at_s, self.rate = 0.0, 0.0

    @property
    def progress(self) -> float:
        """Share of the planned time that is behind, 0 to 1."""
        return 1.0 if self._end_s == 0.0 else self._at_s / self._end_s

    @property
    def positions(self) -> FloatArray:
        """Positions (d,) on the path."""
        if self._path is None or self._at_s >= self._end_s:
            return self._last
        return np.asarray(self._path(self._at_s))

    @property
    def planned_velocities(self) -> FloatArray:
        """Velocities (d,) here at the rate 1."""
        return self._planned(self._at_s)

    def step(self, share: float, elapsed_ns: int) -> FloatArray:
        """Positions (d,) after ``elapsed_ns``, at a rate that tends to ``share``, 0 to 1."""
        step_s = min(max(elapsed_ns, 0), _MAX_STEP_NS) / NS_PER_S
        if step_s > 0.0:
            self.rate = self._next_rate(min(max(share, 0.0), self._max_rate), step_s)
            # A step that passed a state of rest would cut its corner.
            rest_s = float(self._rests_s[self._rests_s > self._at_s].min(initial=self._end_s))
            ahead_s = self._at_s + self.rate * step_s
            self._at_s = ahead_s if ahead_s < rest_s - _ROUNDING_S else rest_s
        return self.positions

    def _planned(self, at_s: float) -> FloatArray:
        if self._path is None or at_s >= self._end_s:
            return np.zeros_like(self._last)
        return np.asarray(self._path(at_s, 1))

    def _next_rate(self, desired: float, step_s: float) -> float:
        """The rate nearest to ``desired`` at which no joint exceeds its acceleration."""
        now = self.rate * self._planned(self._at_s)
        ahead = self._planned(self._at_s + self.rate * step_s)
        moving = ahead != 0.0
        speed, change = np.abs(ahead[moving]), self._accelerations[moving] * step_s
        along = now[moving] * np.sign(ahead[moving])
        lowest = float(((along - change) / speed).max(initial=0.0))
        highest = float(((along + change) / speed).min(initial=self._max_rate))
        return min(max(desired, lowest), max(highest, lowest), self._max_rate)


_MAX_BYTES = 64_000_000


class Plan(NamedTuple):
    """The motion of a plan, its JSON, and the values of that."""

    motion: PlannedMotion
    text: str
    values: Any


def read_plan(path: Path) -> Plan:
    """Read the plan at ``path``. Raises `InputError` for the first fault."""
    content = read_bounded(path, _MAX_BYTES)
    try:
        return parse_plan(content.decode(), str(path))
    except UnicodeDecodeError as error:
        raise InputError(f"{path} is not JSON: {error}") from error


def parse_plan(text: str, place: str = "plan") -> Plan:
    """The plan in ``text``, which ``place`` names. Raises `InputError` for the first fault."""
    if len(text) > _MAX_BYTES:
        raise InputError(f"{place}: has {len(text)} characters; expected at most {_MAX_BYTES}")
    values = parse_json(text, place)
    with named_faults(place):
        return Plan(_motion(values), text, values)


@contextmanager
def named_faults(place: str) -> Iterator[None]:
    """Name ``place`` in the `InputError` that each fault of a plan's values raises."""
    try:
        yield
    except InputError as error:
        raise InputError(f"{place}: {error}") from error
    except (KeyError, TypeError, ValueError, AttributeError, OverflowError) as error:
        raise InputError(
            f"{place}: is not a plan ({type(error).__name__}: {error}); expected the JSON of "
            "'marginguard plan approach'"
        ) from error


def _motion(values: Any) -> PlannedMotion:
    times_ns = np.array(values["times_ns"])
    limits = values["limits"]
    if times_ns.dtype != np.int64:
        raise TypeError("times_ns are no integers")
    return PlannedMotion(
        _text(values["robot"]),
        tuple(map(_text, values["joints"])),
        {_text(name): float(value) for name, value in values["held"].items()},
        times_ns,
        np.array(values["positions"], dtype=np.float64),
        np.array(values["velocities"], dtype=np.float64),
        np.array([float(limits[name]["acceleration"]) for name in values["joints"]]),
        _text(values["made_from"].get("setup_id", "")),
    )


def _text(value: Any) -> str:
    if not isinstance(value, str):
        raise TypeError(f"{value!r} is no text")
    return value
