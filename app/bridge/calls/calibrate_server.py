"""``~/calibrate``: tip, shaft or landmark from the poses that tf brings while the goal runs."""

import math
import time
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from marginguard_msgs.action import Calibrate

from app.bridge import messages
from app.bridge.calls.action_server import ActionServer, Ending, ServedGoal
from app.bridge.messages import MM_PER_M
from app.bridge.node import RosNode
from app.bridge.tf import TfError, TransformBuffer
from app.geometry import FloatArray, InputError, Stamp, TrackedTransform, TrackingStatus, Transform
from app.registration import (
    DwellSettings,
    calibrate_pivot,
    calibrate_spin,
    detect_dwells,
    select_poses,
    tip_transform,
)

_LOOK_S = 0.005
_FEEDBACK_S = 0.1
_MOST_SAMPLES = 10_000
_LONGEST_S = 3600.0
_METHODS = (Calibrate.Goal.PIVOT, Calibrate.Goal.SPIN, Calibrate.Goal.LANDMARK)
_HINTS = {
    Calibrate.Goal.PIVOT: "turn the tool about its tip, as far as it goes, in all directions",
    Calibrate.Goal.SPIN: "turn the tool about its shaft, the tip kept in its place",
    Calibrate.Goal.LANDMARK: "keep the tip still on the landmark",
}


class _Found(NamedTuple):
    transform: Transform
    residual: float
    accepted: bool
    reason: str


@dataclass(slots=True)
class _Collection:
    """The poses so far; of a tool that turns, those alone that differ from the last one kept."""

    method: int
    samples: list[TrackedTransform] = field(default_factory=list)
    variation_rad: float = 0.0

    def add(self, pose: Transform, stamp_ns: int) -> None:
        if self.samples and not self._differs(pose):
            return
        self.samples.append(TrackedTransform(pose, Stamp(stamp_ns), TrackingStatus.OK))
        self.variation_rad = max(self.variation_rad, pose.angle_to(self.poses[0]))

    @property
    def poses(self) -> list[Transform]:
        return [each.transform for each in self.samples if each.transform is not None]

    def _differs(self, pose: Transform) -> bool:
        if self.method == Calibrate.Goal.LANDMARK:
            return True
        pair = (self.poses[-1], pose)
        if self.method == Calibrate.Goal.SPIN:
            # By angle alone: a sensor beside the shaft hardly moves when the tool is spun.
            return len(select_poses(pair, min_distance_mm=0.0)) > 1
        return len(select_poses(pair)) > 1


class CalibrateServer:
    """Serves the action on ``ros`` until the node is closed; ``buffer`` is what tf has brought.

    Poses are ``parent_frame_from_frame`` at their own stamps, over whatever edges lie between; a
    pose that does not change any more is not counted twice. What is found is given back and not
    published: whoever asked decides.
    """

    def __init__(self, ros: RosNode, buffer: TransformBuffer) -> None:
        self._buffer = buffer
        self._action = ActionServer(ros, Calibrate, "~/calibrate", self._run)

    def _run(self, served: ServedGoal) -> tuple[Calibrate.Result, Ending]:
        goal: Calibrate.Goal = served.request
        _check(goal)
        collected = self._collect(served, goal)
        count = len(collected.samples)
        if served.cancelled.is_set():
            message = f"cancelled after {count} poses"
            return Calibrate.Result(message=message, samples=count), Ending.CANCELLED
        if not collected.samples:
            raise InputError(
                f"no pose of {goal.frame!r} in {goal.parent_frame!r} came within {goal.timeout:g} s"
            )
        found = self._find(goal, collected)
        result = Calibrate.Result(
            success=found.accepted,
            message="" if found.accepted else found.reason,
            transform=messages.transform_message(
                found.transform, Stamp(collected.samples[-1].stamp.ns)
            ),
            residual=found.residual,
            samples=count,
        )
        return result, Ending.SUCCEEDED if found.accepted else Ending.ABORTED

    def _collect(self, served: ServedGoal, goal: Calibrate.Goal) -> _Collection:
        collected = _Collection(goal.method)
        until_s = time.monotonic() + goal.timeout
        told_s, last_ns = -math.inf, self._latest_ns(goal)
        while len(collected.samples) < goal.samples and time.monotonic() < until_s:
            if served.cancelled.wait(_LOOK_S):
                break
            stamp_ns = self._latest_ns(goal)
            if stamp_ns is not None and stamp_ns != last_ns:
                last_ns = stamp_ns
                self._take(collected, goal, stamp_ns)
            if time.monotonic() - told_s >= _FEEDBACK_S:
                told_s = time.monotonic()
                served.feedback(_feedback(goal, collected, seen=last_ns is not None))
        served.feedback(_feedback(goal, collected, seen=last_ns is not None))
        return collected

    def _latest_ns(self, goal: Calibrate.Goal) -> int | None:
        try:
            return self._buffer.latest_common_ns(goal.parent_frame, goal.frame)
        except TfError:
            return None  # not known yet: the hint says so, and the time runs out

    def _take(self, collected: _Collection, goal: Calibrate.Goal, stamp_ns: int) -> None:
        try:
            found = self._buffer.lookup(goal.parent_frame, goal.frame, stamp_ns)
        except TfError:
            return  # forgotten between the two looks, as after a jump of the clock
        collected.add(found.transform, stamp_ns)

    def _find(self, goal: Calibrate.Goal, collected: _Collection) -> _Found:
        if goal.method == Calibrate.Goal.PIVOT:
            pivot = calibrate_pivot(collected.poses)
            return _Found(
                pivot.tool_from_tip(_tip_frame(goal)),
                _rms(np.delete(pivot.residuals_mm, pivot.outliers)) / MM_PER_M,
                pivot.accepted,
                pivot.reason,
            )
        if goal.method == Calibrate.Goal.SPIN:
            return self._find_shaft(goal, collected)
        return _find_landmark(goal, collected)

    def _find_shaft(self, goal: Calibrate.Goal, collected: _Collection) -> _Found:
        try:
            tip = self._buffer.lookup(goal.frame, _tip_frame(goal)).transform.translation_mm
        except TfError as error:
            raise InputError(f"a spin needs the tip, from a pivot before it: {error}") from error
        spin = calibrate_spin(collected.poses, tip_mm=tip)
        frames = {"tool_frame": goal.frame, "tip_frame": _tip_frame(goal)}
        return _Found(
            tip_transform(tip, spin.shaft, **frames),
            _rms(np.delete(spin.residuals_rad, spin.outliers)),
            spin.accepted,
            spin.reason,
        )


def _find_landmark(goal: Calibrate.Goal, collected: _Collection) -> _Found:
    settings = DwellSettings(min_turn_rad=0.0)
    dwells = detect_dwells(collected.samples, settings)
    if not dwells:
        raise InputError(
            f"{goal.frame} did not keep still: within {settings.tip_box_mm:g} mm for "
            f"{settings.dwell_s:g} s wanted"
        )
    dwell = dwells[-1]
    landmark = Transform(goal.parent_frame, "landmark", np.eye(3), dwell.position_mm)
    return _Found(landmark, dwell.spread_mm / MM_PER_M, True, "")


def _check(goal: Calibrate.Goal) -> None:
    if goal.method not in _METHODS:
        raise InputError(f"method {goal.method} of a calibration: {_METHODS} wanted")
    if not goal.frame or not goal.parent_frame or goal.frame == goal.parent_frame:
        raise InputError(
            f"frame {goal.frame!r} in {goal.parent_frame!r}: two different frames wanted"
        )
    if not 1 <= goal.samples <= _MOST_SAMPLES:
        raise InputError(f"{goal.samples} samples asked for: 1 to {_MOST_SAMPLES} wanted")
    if not 0.0 < goal.timeout <= _LONGEST_S:
        raise InputError(f"timeout of {goal.timeout} s: above 0, at most {_LONGEST_S:g} s wanted")


def _feedback(goal: Calibrate.Goal, collected: _Collection, *, seen: bool) -> Calibrate.Feedback:
    return Calibrate.Feedback(
        samples=len(collected.samples),
        variation=collected.variation_rad,
        hint=_HINTS[goal.method] if seen else f"no pose of {goal.frame} in {goal.parent_frame} yet",
    )


def _tip_frame(goal: Calibrate.Goal) -> str:
    return f"{goal.frame}_tip"


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2)))
