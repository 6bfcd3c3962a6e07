"""``~/calibrate``: estimate a tip, shaft or landmark from tf poses received during the goal."""

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from marginguard_msgs.action import Calibrate

from app.bridge import messages
from app.bridge.calls.action_server import ActionServer, GoalOutcome, ServedGoal
from app.bridge.messages import MM_PER_M
from app.bridge.node import RosNode
from app.bridge.ros_errors import TfError
from app.bridge.tf import TransformBuffer
from app.geometry import FloatArray, InputError, Stamp, TrackedTransform, TrackingStatus, Transform
from app.registration import (
    DwellSettings,
    calibrate_pivot,
    calibrate_spin,
    detect_dwells,
    select_poses,
    tip_transform,
)

_POLL_INTERVAL_S = 0.005
_FEEDBACK_INTERVAL_S = 0.1
_MAX_SAMPLES = 10_000
_MAX_TIMEOUT_S = 3600.0


@dataclass(slots=True)
class _Collection:
    """Collected poses without those that do not differ enough from the last one kept.

    ``differs`` decides it for the last kept and a new pose.
    """

    differs: Callable[[Transform, Transform], bool]
    samples: list[TrackedTransform] = field(default_factory=list)
    variation_rad: float = 0.0

    def add(self, pose: Transform, stamp_ns: int) -> None:
        if self.samples and not self.differs(self.poses[-1], pose):
            return
        self.samples.append(TrackedTransform(pose, Stamp(stamp_ns), TrackingStatus.OK))
        self.variation_rad = max(self.variation_rad, pose.angle_to(self.poses[0]))

    @property
    def poses(self) -> list[Transform]:
        return [each.transform for each in self.samples if each.transform is not None]

    def result(self, found: Transform, residual: float, fault: str = "") -> Calibrate.Result:
        return Calibrate.Result(
            success=not fault,
            message=fault,
            transform=messages.transform_message(found, Stamp(self.samples[-1].stamp.ns)),
            residual=residual,
            samples=len(self.samples),
        )


class CalibrateServer:
    """Serves the action on ``ros`` until the node is closed; looks poses up in ``buffer``.

    Poses are ``parent_frame_from_frame`` at the stamps of their samples. A sample is used once.
    The calibration is returned in the result and not published.
    """

    def __init__(self, ros: RosNode, buffer: TransformBuffer) -> None:
        self._buffer = buffer
        self._action = ActionServer(ros, Calibrate, "~/calibrate", self._run)

    def _run(self, served: ServedGoal) -> tuple[Calibrate.Result, GoalOutcome]:
        goal: Calibrate.Goal = served.request
        _check(goal)
        collected = self._collect(served, goal)
        count = len(collected.samples)
        if served.cancelled.is_set():
            message = f"cancelled after {count} poses"
            return Calibrate.Result(message=message, samples=count), GoalOutcome.CANCELLED
        if not collected.samples:
            raise InputError(
                f"no pose of {goal.frame!r} in {goal.parent_frame!r} received within "
                f"{goal.timeout:g} s"
            )
        result = _METHODS[goal.method].estimate(goal, collected, self._buffer)
        return result, GoalOutcome.SUCCEEDED if result.success else GoalOutcome.ABORTED

    def _collect(self, served: ServedGoal, goal: Calibrate.Goal) -> _Collection:
        collected = _Collection(_METHODS[goal.method].differs)
        end_s = time.monotonic() + goal.timeout
        feedback_s, last_ns = -math.inf, self._latest_ns(goal)
        while len(collected.samples) < goal.samples and time.monotonic() < end_s:
            if served.cancelled.wait(_POLL_INTERVAL_S):
                break
            stamp_ns = self._latest_ns(goal)
            if stamp_ns is not None and stamp_ns != last_ns:
                last_ns = stamp_ns
                self._collect_pose(collected, goal, stamp_ns)
            if time.monotonic() - feedback_s >= _FEEDBACK_INTERVAL_S:
                feedback_s = time.monotonic()
                served.feedback(_feedback(goal, collected, has_pose=last_ns is not None))
        served.feedback(_feedback(goal, collected, has_pose=last_ns is not None))
        return collected

    def _latest_ns(self, goal: Calibrate.Goal) -> int | None:
        try:
            return self._buffer.latest_common_ns(goal.parent_frame, goal.frame)
        except TfError:
            return None  # the frames are not connected yet; the feedback's hint reports it

    def _collect_pose(self, collected: _Collection, goal: Calibrate.Goal, stamp_ns: int) -> None:
        try:
            result = self._buffer.lookup(goal.parent_frame, goal.frame, stamp_ns)
        except TfError:
            return  # the buffer was cleared in between, for example by a clock jump
        collected.add(result.transform, stamp_ns)


class _Method(NamedTuple):
    """One method of the action.

    ``hint`` is the instruction for the operator, ``differs`` the selection of poses (see
    `_Collection`), ``estimate`` the computation. It raises `InputError`.
    """

    hint: str
    differs: Callable[[Transform, Transform], bool]
    estimate: Callable[[Calibrate.Goal, _Collection, TransformBuffer], Calibrate.Result]


def _rotated(last: Transform, pose: Transform) -> bool:
    # Compare angles only: a sensor near the tip or the shaft hardly moves.
    return len(select_poses((last, pose), min_distance_mm=0.0)) > 1


def _calibrate_tip(
    goal: Calibrate.Goal, collected: _Collection, buffer: TransformBuffer
) -> Calibrate.Result:
    pivot = calibrate_pivot(collected.poses)
    return collected.result(
        pivot.tool_from_tip(_tip_frame(goal)),
        _rms(np.delete(pivot.residuals_mm, pivot.outliers)) / MM_PER_M,
        "" if pivot.accepted else pivot.reason,
    )


def _calibrate_shaft(
    goal: Calibrate.Goal, collected: _Collection, buffer: TransformBuffer
) -> Calibrate.Result:
    try:
        tip = buffer.lookup(goal.frame, _tip_frame(goal)).transform.translation_mm
    except TfError as error:
        raise InputError(
            f"a spin calibration needs the tip of a previous pivot calibration: {error}"
        ) from error
    spin = calibrate_spin(collected.poses, tip_mm=tip)
    frames = {"tool_frame": goal.frame, "tip_frame": _tip_frame(goal)}
    return collected.result(
        tip_transform(tip, spin.shaft, **frames),
        _rms(np.delete(spin.residuals_rad, spin.outliers)),
        "" if spin.accepted else spin.reason,
    )


def _locate_landmark(
    goal: Calibrate.Goal, collected: _Collection, buffer: TransformBuffer
) -> Calibrate.Result:
    settings = DwellSettings(min_turn_rad=0.0)
    dwells = detect_dwells(collected.samples, settings)
    if not dwells:
        raise InputError(
            f"{goal.frame} did not hold still; expected it within {settings.tip_box_mm:g} mm for "
            f"{settings.dwell_s:g} s"
        )
    dwell = dwells[-1]
    landmark = Transform(goal.parent_frame, "landmark", np.eye(3), dwell.position_mm)
    return collected.result(landmark, dwell.spread_mm / MM_PER_M)


_METHODS: dict[int, _Method] = {
    Calibrate.Goal.PIVOT: _Method(
        "pivot the tool about its tip, as far as possible in all directions",
        _rotated,
        _calibrate_tip,
    ),
    Calibrate.Goal.SPIN: _Method(
        "spin the tool about its shaft with the tip held in place", _rotated, _calibrate_shaft
    ),
    Calibrate.Goal.LANDMARK: _Method(
        "hold the tip still on the landmark", lambda last, pose: True, _locate_landmark
    ),
}


def _check(goal: Calibrate.Goal) -> None:
    if goal.method not in _METHODS:
        raise InputError(f"calibration method is {goal.method}; expected one of {tuple(_METHODS)}")
    if not goal.frame or not goal.parent_frame or goal.frame == goal.parent_frame:
        raise InputError(
            f"frame {goal.frame!r} and parent_frame {goal.parent_frame!r}; "
            "expected two different frames"
        )
    if not 1 <= goal.samples <= _MAX_SAMPLES:
        raise InputError(f"samples is {goal.samples}; expected 1 to {_MAX_SAMPLES}")
    if not 0.0 < goal.timeout <= _MAX_TIMEOUT_S:
        raise InputError(
            f"timeout is {goal.timeout} s; expected more than 0 and at most {_MAX_TIMEOUT_S:g} s"
        )


def _feedback(
    goal: Calibrate.Goal, collected: _Collection, *, has_pose: bool
) -> Calibrate.Feedback:
    no_pose = f"no pose of {goal.frame} in {goal.parent_frame} yet"
    return Calibrate.Feedback(
        samples=len(collected.samples),
        variation=collected.variation_rad,
        hint=_METHODS[goal.method].hint if has_pose else no_pose,
    )


def _tip_frame(goal: Calibrate.Goal) -> str:
    return f"{goal.frame}_tip"


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2)))
