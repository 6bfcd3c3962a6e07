"""Motion that a controller may request by the constraint of the last step, and for how long."""

from dataclasses import dataclass, replace

import numpy as np

from app.bridge.ros_errors import BridgeError, TfError
from app.bridge.tf import TransformBuffer
from app.fixture import MAX_TURN_RAD_S, Constraint, LimiterParameters, MarginParameters
from app.geometry import (
    FloatArray,
    FrameError,
    Freshness,
    FreshnessLimits,
    Stamp,
    freshness_of,
    freshness_of_stamp,
    stale_in_ns,
)
from app.session import KnownEdges, StepResult


class TwistRefusedError(BridgeError):
    """The command cannot be limited by the constraint; the reply is a zero twist.

    ``kind`` is one of a fixed set; only ``detail`` contains data from the network.
    """

    def __init__(self, kind: str, detail: str = "") -> None:
        self.kind = kind
        super().__init__(f"{kind}: {detail}" if detail else kind)


@dataclass(frozen=True, slots=True, eq=False)
class Allowance:
    """Constraint of the last step for the tool's tip at ``tip_mm`` (3,) in the tumour's frame.

    ``edges`` are those of the step at ``now_ns``, ``stamp_ns`` is the time of its oldest sample;
    both on the tracker's clock. ``since_ns`` is ``now_ns`` on the steady clock, and ``until_ns``
    the end of the validity there.
    """

    constraint: Constraint
    parameters: LimiterParameters
    tip_mm: FloatArray
    edges: KnownEdges
    stamp_ns: int
    now_ns: int
    stale_after_ns: int
    since_ns: int
    until_ns: int
    max_approach_mm_s: float

    @property
    def poses_ns(self) -> int:
        """``stamp_ns`` on the steady clock."""
        return self.since_ns - (self.now_ns - self.stamp_ns)

    def until_of(self, stamp: Stamp | None) -> int:
        """Steady time until which a pose of ``stamp`` may be used, None for static edges."""
        if stamp is None:
            return self.until_ns
        limits = FreshnessLimits(self.stale_after_ns)
        return min(self.until_ns, self.since_ns + stale_in_ns(stamp.ns, self.now_ns, limits))

    def rotation(self, frame: str, buffer: TransformBuffer) -> tuple[FloatArray, int]:
        """Rotation (3, 3) of ``tumor_from_frame``, and the steady time until which it is valid."""
        tumor = self.constraint.frame
        if frame == tumor:
            return np.eye(3), self.until_ns
        known = self.edges.frames() | {tumor}
        anchor, beyond = frame, np.eye(3)
        if frame not in known:
            anchor, beyond = self._foreign_rotation(frame, known, buffer)
        if anchor == tumor:
            return beyond, self.until_ns
        try:
            tumor_from_anchor, stamp = self.edges.between(tumor, anchor)
        except FrameError as error:
            raise TwistRefusedError("frame of a command", str(error)) from error
        return tumor_from_anchor.rotation @ beyond, self.until_of(stamp)

    def _foreign_rotation(
        self, frame: str, known: frozenset[str], buffer: TransformBuffer
    ) -> tuple[str, FloatArray]:
        """The known frame that ``frame`` hangs on, and the rotation (3, 3) from ``frame`` to it.

        At the time of the planes or before it.
        """
        try:
            anchors = sorted(buffer.attachments(frame, known))
            if len(anchors) != 1:
                names = ", ".join(anchors) or "none"
                raise TwistRefusedError(
                    "frame of a command",
                    f"{frame!r} is connected with the known frames {names}; expected one",
                )
            anchor = anchors[0]
            found = buffer.lookup(anchor, frame)
            if found.stamp_ns is None:  # static edges alone, which hold at any time
                return anchor, found.transform.rotation
            # The planes may be up to the limit old while tf goes on, so its newest pose may be as
            # far ahead of them. Then the pose at the time of the planes is used instead.
            limits = FreshnessLimits(self.stale_after_ns, future_tolerance_ns=self.stale_after_ns)
            freshness = freshness_of(found.stamp_ns, self.stamp_ns, limits)
            if freshness is not Freshness.VALID:
                late = "from the future" if freshness is Freshness.FUTURE else "stale"
                raise TwistRefusedError("way to the frame of a command", f"{frame!r} is {late}")
            if found.stamp_ns > self.stamp_ns:
                found = buffer.lookup(anchor, frame, self.stamp_ns)
        except TfError as error:
            raise TwistRefusedError("frame of a command", str(error)) from error
        return anchor, found.transform.rotation


def allowance_of(
    step: StepResult, margins: MarginParameters, begin_ns: int, parameters: LimiterParameters
) -> Allowance | None:
    """The allowance of ``step``; None if it has no planes for the tool's pose in that step.

    ``begin_ns`` is the steady time at which the step's frame was current.
    """
    decision, pose = step.decision, step.tumor_from_tip
    constraint, stamp = decision.constraint, decision.stamp
    if constraint is None or not decision.constraint_is_current or stamp is None or pose is None:
        return None
    limits, now = FreshnessLimits(margins.stale_after_ns), step.frame.stamp
    if freshness_of_stamp(stamp, now, limits) is not Freshness.VALID:
        return None
    max_turn_rad_s = min(parameters.max_turn_rad_s, MAX_TURN_RAD_S)
    return Allowance(
        constraint=constraint,
        parameters=replace(parameters, max_turn_rad_s=max_turn_rad_s),
        tip_mm=pose.translation_mm,
        edges=step.edges,
        stamp_ns=stamp.ns,
        now_ns=now.ns,
        stale_after_ns=margins.stale_after_ns,
        since_ns=begin_ns,
        until_ns=begin_ns + stale_in_ns(stamp.ns, now.ns, limits),
        max_approach_mm_s=margins.v_max_mm_s,
    )
