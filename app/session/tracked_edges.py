"""Rules for the measured edges of a frame, as one compiled call over arrays.

A record of `EDGE` holds all that is known of one edge, a record of `SOURCE_REPETITION` what is
known of the tracker that measures it, by the target frame. Every rule stands here, in
`app.session.repetition` or in `app.session.sensor_motion`, and runs as plain Python too.
"""

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from app.fixture import Reason
from app.fixture.control.states import BITS_OF_FRESHNESS, reason_bits
from app.fixture.jit import inlined, kernel, renew_with
from app.fixture.vectors import dot, rotate_inverse, row
from app.geometry import FloatArray, TrackingStatus, stamp
from app.session import repetition, sensor_motion
from app.session.repetition import (
    SENSOR_REPETITION,
    change,
    copy_pose,
    do_all_repeat_improbably,
    end_frame,
    is_stuck,
    keep_change,
    note_sensor,
    repeat,
    unchanged_ns,
)
from app.session.sensor_motion import (
    SENSOR_MOTION,
    Record,
    State,
    is_same_rotation,
    update_motion,
)

MAX_TRANSLATION_MM = 10_000.0
"""No tracker of an operating room measures beyond 10 m. Drivers send larger numbers for a missing
pose (NDI: -3.7e28), whatever the status is."""

REASON_OF_STATUS = {
    TrackingStatus.INVALID: Reason.INVALID,
    TrackingStatus.MISSING: Reason.MISSING,
    TrackingStatus.OUT_OF_VIEW: Reason.MISSING,
    TrackingStatus.OUT_OF_VOLUME: Reason.MISSING,
    TrackingStatus.REQUEST_TIMEOUT: Reason.MISSING,
    TrackingStatus.NOT_FINITE: Reason.NOT_FINITE,
    TrackingStatus.NOT_RIGID: Reason.NOT_RIGID,
}

_BITS_OF_STATUS = (0, *(reason_bits([REASON_OF_STATUS[each]]) for each in TrackingStatus if each))
_TOO_FAR, _FROZEN = reason_bits([Reason.INVALID]), reason_bits([Reason.FROZEN])
_OK = int(TrackingStatus.OK)

EDGE = np.dtype(
    [
        ("source", np.int64),  # the number of its tracker
        ("has_sensor", np.bool_),  # it touches a moving frame: a repetition is no fixed transform
        ("is_shown_only", np.bool_),  # no decision depends on it
        ("is_checked", np.bool_),  # a pose that its sensor cannot have reached is refused
        ("is_seen", np.bool_),  # there is a sample since the last jump of the clock
        ("seen_ns", np.int64),  # stamp of the latest one
        ("is_known", np.bool_),  # one of them was taken
        ("ns", np.int64),  # stamp of the latest one that was
        ("bad", np.int64),  # its problems that do not depend on its age
        ("is_good", np.bool_),  # there is a good sample since the last jump: the latest one's
        ("rotation", np.float64, (3, 3)),  # pose in mm, and the time of its first repetition
        ("position", np.float64, 3),
        ("unchanged_since_ns", np.int64),
        ("has_changed", np.bool_),  # the pose has changed, ever
        ("unchanged_ns", np.int64),  # verdict at the present: as in `MeasuredPose`
        ("problems", np.int64),  # `reason_bits`
        ("repetition", SENSOR_REPETITION),
        ("motion", SENSOR_MOTION),
    ],
    align=True,
)

SAMPLE = np.dtype(
    [
        ("edge", np.int64),
        ("ns", np.int64),
        ("status", np.int64),
        ("rotation", np.float64, (3, 3)),  # of no meaning unless the status is OK
        ("position", np.float64, 3),  # in mm
        ("outcome", np.int64),
    ],
    align=True,
)

TAKEN, LATE, REFUSED = range(3)
"""Outcome of a sample: the edge's latest; acquired before the one seen last; not plausible."""

PATH = np.dtype(
    [
        ("first", np.int64),  # of its steps, and their number; -1 if the frames are not connected
        ("count", np.int64),
        ("oldest", np.int64),  # the edge with the earliest stamp; -1 without one
        ("unchanged_ns", np.int64),  # as in `MeasuredPose`, as the next ones
        ("problems", np.int64),
        ("outer_rotation", np.float64, (3, 3)),  # fixed poses, in mm, before and behind those of
        ("outer_position", np.float64, 3),  # the edges
        ("inner_rotation", np.float64, (3, 3)),
        ("inner_position", np.float64, 3),
        ("rotation", np.float64, (3, 3)),  # the product; of no meaning if there are problems
        ("position", np.float64, 3),
    ],
    align=True,
)
"""Product of the poses along a path of edges."""

Steps: TypeAlias = NDArray[np.int64]

LIMITS = np.dtype([("stale_ns", np.int64), ("frozen_ns", np.int64), ("future_ns", np.int64)])
"""`FreshnessLimits.numbers_ns`."""

_freshness_number = inlined(stamp.freshness_number)


@kernel
def take_samples(
    samples: State,
    count: int,
    now_ns: int,
    limits: State,
    edges: State,
    sources: State,
    paths: State,
    steps: Steps,
) -> int:
    """Take the first ``count`` of the ``samples`` (k,), those of a frame at ``now_ns``.

    Writes the outcome of each sample, the state and the verdict of all ``edges`` (n,), the state of
    their ``sources`` (m,), and the poses along all ``paths`` (p,). Returns the number of samples
    that are not the latest of an edge that was known before; if there are any, the paths may have
    changed.
    """
    others = 0
    for k in range(count):
        sample = samples[k]
        edge = edges[sample["edge"]]
        was_known = edge["is_known"]
        sample["outcome"] = _take(edge, sample, now_ns, limits[0]["frozen_ns"])
        others += 0 if was_known and sample["outcome"] == TAKEN else 1
        if sample["outcome"] == TAKEN and _shows_source(edge):
            note_sensor(sources[edge["source"]], edge["repetition"]["duration_ns"])
    for m in range(len(sources)):
        end_frame(sources[m], limits[0]["stale_ns"])
    judge_edges(edges, sources, limits, now_ns)
    follow_paths(paths, steps, edges)
    return others


@kernel
def _take(edge: Record, sample: Record, now_ns: int, frozen_after_ns: int) -> int:
    """Make ``sample`` the latest of ``edge`` unless it is late or not plausible; its outcome.

    A sample is late after a newer one, even after one that was refused, unless that was stamped in
    the future. Lost samples in between do not end a frozen run. A stamp from the future counts as
    ``now_ns``, because no sample can have been acquired later.
    """
    ns, status = sample["ns"], sample["status"]
    rotation, position, at_ns = sample["rotation"], sample["position"], min(ns, now_ns)
    if edge["is_seen"] and ns < edge["seen_ns"] and edge["seen_ns"] <= now_ns:
        return LATE
    edge["is_seen"], edge["seen_ns"] = True, ns
    is_pose = status == _OK and not _is_too_far(position)
    is_checked = is_pose and edge["is_checked"]
    if is_checked and not update_motion(edge["motion"], rotation, position, at_ns):
        return REFUSED
    edge["is_known"], edge["ns"], edge["bad"] = True, ns, _BITS_OF_STATUS[status]
    if is_pose:
        _note_pose(edge, rotation, position, at_ns, frozen_after_ns)
    elif status == _OK:
        edge["bad"] = _TOO_FAR
    return TAKEN


@kernel
def _is_too_far(position: FloatArray) -> bool:
    """True for a position (3,) beyond `MAX_TRANSLATION_MM`, which no tracker has measured."""
    x, y, z = abs(position[0]), abs(position[1]), abs(position[2])
    limit_mm = MAX_TRANSLATION_MM
    return not (x <= limit_mm and y <= limit_mm and z <= limit_mm)


@kernel
def _note_pose(
    edge: Record, rotation: FloatArray, position: FloatArray, at_ns: int, frozen_after_ns: int
) -> None:
    """Make a good pose the latest of ``edge``: the first one, a repetition or a change."""
    sensor, before = edge["repetition"], edge["position"]
    is_same = before[0] == position[0] and before[1] == position[1] and before[2] == position[2]
    if edge["is_good"] and is_same and is_same_rotation(edge["rotation"], rotation):
        repeat(sensor, at_ns - edge["unchanged_since_ns"])
        return
    edge["unchanged_since_ns"] = at_ns
    if edge["is_good"]:
        edge["has_changed"] = True
        change(sensor, rotation, position, at_ns, frozen_after_ns)
    else:
        edge["is_good"] = True
        keep_change(sensor, rotation, position, at_ns, 0.0)
    copy_pose(rotation, position, edge["rotation"], edge["position"])


@inlined
def _has_to_move(edge: Record) -> bool:
    return bool(edge["has_changed"] or edge["has_sensor"])


@inlined
def _shows_source(edge: Record) -> bool:
    """True if the latest sample shows that the tracker goes on: a decision may depend on it."""
    return bool(edge["bad"] == 0 and not edge["is_shown_only"] and _has_to_move(edge))


@kernel
def judge_edges(edges: State, sources: State, limits: State, now_ns: int) -> None:
    """Write the time without a change and the problems at ``now_ns`` of all known ``edges``."""
    for k in range(len(edges)):
        edge = edges[k]
        if edge["is_known"]:
            _judge(edge, sources[edge["source"]], limits[0], now_ns)


@kernel
def _judge(edge: Record, source: Record, limits: Record, now_ns: int) -> None:
    sensor, stale_ns, frozen_ns = edge["repetition"], limits["stale_ns"], limits["frozen_ns"]
    unchanged = 0
    if sensor["repeats"] and _has_to_move(edge):
        all_improbable = do_all_repeat_improbably(source)
        unchanged = unchanged_ns(sensor, all_improbable, source["duration_ns"], frozen_ns)
    problems = edge["bad"]
    if not problems:
        age_ns, future_ns = now_ns - edge["ns"], limits["future_ns"]
        verdict = _freshness_number(age_ns, unchanged, stale_ns, frozen_ns, future_ns)
        problems = BITS_OF_FRESHNESS[verdict]
        # A frozen sensor whose samples also come late is reported with both reasons.
        if verdict and _freshness_number(0, unchanged, stale_ns, frozen_ns, future_ns):
            problems |= _FROZEN
    if sensor["repeats"] and is_stuck(source, stale_ns):
        problems |= _FROZEN
    edge["unchanged_ns"], edge["problems"] = unchanged, problems


@kernel
def follow_paths(paths: State, steps: Steps, edges: State) -> None:
    """Write verdict and pose of each of ``paths`` (p,), from those of the ``edges``.

    ``steps`` (s, 2) holds the number of an edge, and 1 where it is walked backwards.
    """
    for k in range(len(paths)):
        path = paths[k]
        path["oldest"], path["unchanged_ns"], path["problems"] = -1, 0, 0
        rotation, position = path["rotation"], path["position"]
        copy_pose(path["outer_rotation"], path["outer_position"], rotation, position)
        oldest_ns = 0
        for n in range(path["first"], path["first"] + path["count"]):
            edge = edges[steps[n, 0]]
            if path["oldest"] < 0 or edge["ns"] < oldest_ns:
                path["oldest"], oldest_ns = steps[n, 0], edge["ns"]
            path["unchanged_ns"] = max(path["unchanged_ns"], edge["unchanged_ns"])
            path["problems"] |= edge["problems"]
            multiply_pose(rotation, position, edge["rotation"], edge["position"], steps[n, 1] == 1)
        multiply_pose(rotation, position, path["inner_rotation"], path["inner_position"], False)


@kernel
def multiply_pose(
    product: FloatArray,
    product_mm: FloatArray,
    rotation: FloatArray,
    position_mm: FloatArray,
    inverse: bool,
) -> None:
    """Multiply the pose ``product`` from the right by another one, or by its inverse.

    Rotations are (3, 3), positions (3,).
    """
    t = (position_mm[0], position_mm[1], position_mm[2])
    if inverse:
        t = rotate_inverse(rotation, (-t[0], -t[1], -t[2]))
    for i in range(3):
        left = row(product, i)
        product_mm[i] += dot(left, t)
        for j in range(3):
            column = (rotation[0, j], rotation[1, j], rotation[2, j])
            product[i, j] = dot(left, row(rotation, j) if inverse else column)


for _function in (take_samples, _take, _note_pose, judge_edges, _judge):
    renew_with(_function, repetition.__file__, sensor_motion.__file__, stamp.__file__)
