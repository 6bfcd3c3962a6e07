"""Probability that a sensor repeats its pose exactly, learned from its own history.

Real trackers quantise: a sensor at rest repeats all digits, and a sensor that moves cannot. One
number for all of them would call a resting sensor frozen, or a stuck one current.
"""

import math

import numpy as np

from app.fixture.jit import inlined, kernel
from app.fixture.vectors import point_distance
from app.geometry import FloatArray
from app.session.sensor_motion import Record, State

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

_CHANGES_AT_REST = 1.0
_CHANGES_IN_MOTION = 100.0
"""Prior changes to one repetition. A sensor in motion does not repeat, until its source is known to
send poses twice."""

_POSITIONS = 4
_STRAIGHT = 0.7
_MIN_STEPS = 2.0
_STEP_OF_AXES = math.sqrt(2.0) * math.radians(0.25)
"""Change of a rotation matrix for 0.25 degrees, more than trackers quantise angles to."""

_HISTORY = np.dtype(
    [
        ("repeats", np.float64),  # samples that repeated the one before, in runs that have ended,
        ("changes", np.float64),  # and samples that differed from it
        ("runs", np.int64),
        ("longest_ns", np.int64, CONFIRMED_BY),  # durations of the longest runs, longest first
    ],
    align=True,
)
"""Counts of samples. A run is a series of repetitions that ended with a change: the sensor was
alive."""

SENSOR_REPETITION = np.dtype(
    [
        ("at_rest", _HISTORY),
        ("in_motion", _HISTORY),
        ("repeats", np.int64),  # of the run that goes on, as the next one
        ("duration_ns", np.int64),
        ("moving", np.bool_),  # True if the sensor was in motion at its last change
        ("step_mm", np.float64),  # the smallest change of the position, 0 before the first one
        ("count", np.int64),  # of changes: change k, when and where it was and how far in mm from
        ("ns", np.int64, _POSITIONS),  # the one before, is kept at k modulo `_POSITIONS`
        ("at", np.float64, (_POSITIONS, 3)),
        ("rotation", np.float64, (_POSITIONS, 3, 3)),
        ("way_mm", np.float64, _POSITIONS),
    ],
    align=True,
)
"""History of one sensor, at rest and in motion, and the run of repetitions that goes on.

A sensor is in motion if its last changes led into one direction and the next sample, at that speed,
lies at least two quantisation steps away. The smallest change of the position in its history is the
step.
"""

SOURCE_REPETITION = np.dtype(
    [
        ("together", _HISTORY),  # frames in which all sensors repeated, against all others
        ("any_repeats", np.float64),
        ("frames", np.float64),
        ("repeats", np.int64),
        ("duration_ns", np.int64),
        ("sensors", np.int64),  # measured in this frame; the shortest and the longest time in ns
        ("shortest_ns", np.int64),  # since the last change of one of them
        ("longest_ns", np.int64),
    ],
    align=True,
)
"""History of the frames of one tracker, in which two sensors or more were measured."""


@kernel
def add_change(history: Record) -> None:
    """Count a sample that differs from the one before."""
    history["changes"] += 1.0
    if history["changes"] + history["repeats"] > MAX_SAMPLES:
        history["changes"] /= 2.0
        history["repeats"] /= 2.0


@kernel
def add_run(history: Record, repeats: int, duration_ns: int) -> None:
    """Count a run of ``repeats`` samples that has ended after ``duration_ns``."""
    history["repeats"] += repeats
    history["runs"] += 1
    longest_ns = history["longest_ns"]
    for k in range(CONFIRMED_BY):
        if duration_ns > longest_ns[k]:
            longest_ns[k], duration_ns = duration_ns, longest_ns[k]


@kernel
def is_known_to_repeat(history: Record) -> bool:
    """True if several runs have ended and repetitions are no exception."""
    share = history["repeats"] / max(1.0, history["repeats"] + history["changes"])
    return bool(history["runs"] >= CONFIRMED_BY and share >= REPEATS_AT_REST)


@kernel
def is_improbable(history: Record, prior_changes: float, repeats: int, duration_ns: int) -> bool:
    """True for a run longer than any known one whose probability is below `IMPROBABLE`.

    Known is a duration that `CONFIRMED_BY` runs have reached.
    """
    if duration_ns <= history["longest_ns"][CONFIRMED_BY - 1]:
        return False
    return probability(history, prior_changes, repeats) < IMPROBABLE


@kernel
def probability(history: Record, prior_changes: float, repeats: int) -> float:
    """Probability that a run reaches ``repeats``, from the counts and the prior.

    Beta-binomial prediction: product of (k + 1 + i) / (n + 1 + b + i) over the repeats, with k
    repetitions in n samples and b ``prior_changes``, the changes to one repetition that are assumed
    before there is a history. With b = 1, a uniform prior, it is 1 / (repeats + 1) without a
    history: nothing is improbable.
    """
    k = history["repeats"] + 1.0
    n = k + history["changes"] + prior_changes
    log = math.lgamma(k + repeats) - math.lgamma(k) + math.lgamma(n) - math.lgamma(n + repeats)
    return math.exp(log)


@kernel
def repeat(sensor: Record, duration_ns: int) -> None:
    """Count a sample that repeats the pose of ``duration_ns`` ago."""
    if duration_ns <= sensor["duration_ns"]:
        return  # the same sample again
    if sensor["repeats"] == 0 and not sensor["moving"]:
        sensor["moving"] = _is_turning(sensor)
    sensor["repeats"] += 1
    sensor["duration_ns"] = duration_ns


@kernel
def change(
    sensor: Record, rotation: FloatArray, position_mm: FloatArray, at_ns: int, frozen_after_ns: int
) -> None:
    """Count a sample with another pose, which ends a run; a frozen run is not learned.

    ``rotation`` (3, 3) and ``position_mm`` (3,) are that pose.
    """
    history = sensor["in_motion"] if sensor["moving"] else sensor["at_rest"]
    if sensor["repeats"]:
        if unchanged_ns(sensor, False, 0, frozen_after_ns) <= frozen_after_ns:
            add_run(history, sensor["repeats"], sensor["duration_ns"])
        sensor["repeats"] = sensor["duration_ns"] = 0
    add_change(history)
    step_mm, count = 0.0, sensor["count"]
    if count > 0:
        step_mm = _distance_mm(sensor["at"][(count - 1) % _POSITIONS], position_mm)
        if step_mm > 0.0 and not 0.0 < sensor["step_mm"] <= step_mm:
            sensor["step_mm"] = step_mm
    keep_change(sensor, rotation, position_mm, at_ns, step_mm)
    sensor["moving"] = False
    if count + 1 >= _POSITIONS:
        path_mm = step_mm
        for k in range(count - 2, count):
            path_mm += sensor["way_mm"][k % _POSITIONS]
        net_mm = _distance_mm(sensor["at"][(count + 1) % _POSITIONS], position_mm)
        sensor["moving"] = _leads_on(sensor, path_mm, net_mm, sensor["step_mm"])


@kernel
def keep_change(
    sensor: Record, rotation: FloatArray, position_mm: FloatArray, at_ns: int, way_mm: float
) -> None:
    """Keep a change, ``way_mm`` from the one before; 0 for the first pose, which changes none."""
    new = sensor["count"] % _POSITIONS
    sensor["count"] += 1
    sensor["ns"][new], sensor["way_mm"][new] = at_ns, way_mm
    copy_pose(rotation, position_mm, sensor["rotation"][new], sensor["at"][new])


@inlined
def copy_pose(
    rotation: FloatArray, position_mm: FloatArray, new: FloatArray, new_mm: FloatArray
) -> None:
    """Copy a rotation (3, 3) and a position (3,) to ``new`` and ``new_mm``."""
    for i in range(3):
        new_mm[i] = position_mm[i]
        for j in range(3):
            new[i, j] = rotation[i, j]


def restart(sensors: State, sources: State) -> None:
    """Forget the present runs and motions, not the histories: the clock has jumped.

    ``sensors`` (n,) and ``sources`` (m,) are records of the two kinds.
    """
    for each in (sensors, sources):
        each["repeats"] = each["duration_ns"] = 0
    sensors["moving"], sensors["count"] = False, 0


@kernel
def unchanged_ns(
    sensor: Record, all_improbable: bool, all_repeat_ns: int, frozen_after_ns: int
) -> int:
    """Time in ns since the last change if the repetition is improbable, otherwise 0.

    A run is improbable by the sensor's own history, or because all sensors of its source repeat for
    improbably long (``all_improbable``), since ``all_repeat_ns``. A value above ``frozen_after_ns``
    is frozen: every run that is longer, except that of a sensor which rests and is known to repeat
    at rest. That one is frozen after `REST_LIMIT` times the limit, or when all sensors repeat for
    longer than the limit.
    """
    repeats, duration_ns = sensor["repeats"], sensor["duration_ns"]
    if repeats == 0:
        return 0
    moving = sensor["moving"]
    history = sensor["in_motion"] if moving else sensor["at_rest"]
    prior_changes = _CHANGES_IN_MOTION if moving else _CHANGES_AT_REST
    improbable = all_improbable or is_improbable(history, prior_changes, repeats, duration_ns)
    all_frozen = all_improbable and all_repeat_ns > frozen_after_ns
    rests = not moving and is_known_to_repeat(history) and not all_frozen
    if duration_ns > (REST_LIMIT * frozen_after_ns if rests else frozen_after_ns):
        return int(duration_ns)
    return int(min(duration_ns, frozen_after_ns)) if improbable else 0


@kernel
def _is_turning(sensor: Record) -> bool:
    """True if the orientation was in motion; computed when a run begins, which is rare."""
    if sensor["count"] < _POSITIONS:
        return False
    path, turns, first = 0.0, sensor["rotation"], sensor["count"]
    for k in range(first, first + _POSITIONS - 1):
        path += _distance_of_axes(turns[k % _POSITIONS], turns[(k + 1) % _POSITIONS])
    net = _distance_of_axes(turns[first % _POSITIONS], turns[(first - 1) % _POSITIONS])
    return _leads_on(sensor, path, net, _STEP_OF_AXES)


@kernel
def _leads_on(sensor: Record, path: float, net: float, step: float) -> bool:
    """True for a straight path whose next sample is at least two steps away at its mean speed.

    ``path`` is the length through all points that are kept, ``net`` that from the first to the last
    of them. A ``step`` of 0 is not known.
    """
    ns, first = sensor["ns"], sensor["count"]
    last_ns = ns[(first - 1) % _POSITIONS]
    elapsed_ns, since_ns = last_ns - ns[first % _POSITIONS], last_ns - ns[(first - 2) % _POSITIONS]
    if elapsed_ns <= 0 or net < _STRAIGHT * path or step == 0.0:
        return False
    return bool(net * since_ns >= _MIN_STEPS * step * elapsed_ns)


@inlined
def _distance_mm(first: FloatArray, second: FloatArray) -> float:
    return point_distance((first[0], first[1], first[2]), (second[0], second[1], second[2]))


@kernel
def _distance_of_axes(first: FloatArray, second: FloatArray) -> float:
    """Frobenius norm of the difference of two rotations (3, 3)."""
    squared = 0.0
    for i in range(3):
        for j in range(3):
            squared += (first[i, j] - second[i, j]) ** 2
    return math.sqrt(squared)


@kernel
def note_sensor(source: Record, duration_ns: int) -> None:
    """Add to the frame a sensor with the time since its last change, 0 for a change."""
    if source["sensors"] == 0:
        source["shortest_ns"] = source["longest_ns"] = duration_ns
    source["sensors"] += 1
    source["shortest_ns"] = min(source["shortest_ns"], duration_ns)
    source["longest_ns"] = max(source["longest_ns"], duration_ns)


@kernel
def end_frame(source: Record, stale_after_ns: int) -> None:
    """Count the frame of the sensors that were noted.

    A frame with one sensor counts only if it changed: it ends a run.
    """
    sensors, shortest_ns, repeats = source["sensors"], source["shortest_ns"], source["repeats"]
    source["sensors"] = 0
    if sensors == 0 or (sensors < MIN_SENSORS and (shortest_ns or not repeats)):
        return
    if shortest_ns:
        source["repeats"] += 1
        source["duration_ns"] = shortest_ns
        return
    if repeats and not is_stuck(source, stale_after_ns):
        add_run(source["together"], repeats, source["duration_ns"])
        source["any_repeats"] += repeats
        source["frames"] += repeats
    source["repeats"] = source["duration_ns"] = 0
    add_change(source["together"])
    source["frames"] += 1.0
    source["any_repeats"] += 1.0 if source["longest_ns"] else 0.0
    if source["frames"] > MAX_SAMPLES:
        source["frames"] /= 2.0
        source["any_repeats"] /= 2.0


@kernel
def do_all_repeat_improbably(source: Record) -> bool:
    """True if all sensors repeat, for longer than is probable in the source's history."""
    repeats = source["repeats"]
    history, duration_ns = source["together"], source["duration_ns"]
    return bool(repeats > 0 and is_improbable(history, _CHANGES_AT_REST, repeats, duration_ns))


@kernel
def is_stuck(source: Record, stale_after_ns: int) -> bool:
    """True if all sensors repeat, for longer than data may be old, and never did before.

    The share of frames in which any sensor repeated is the bound for one repetition of all: a tool
    that comes to rest for the first time quantises as the other sensors do.
    """
    any_repeats, frames = source["any_repeats"], source["frames"]
    if source["duration_ns"] <= stale_after_ns or frames - any_repeats < MIN_CHANGES:
        return False
    share = (any_repeats + 1.0) / (frames + 2.0)
    return bool(share ** float(source["repeats"]) < STUCK)
