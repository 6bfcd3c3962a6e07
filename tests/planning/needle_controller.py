"""A robot's controller for a needle: constraints from tracker frames, velocities by the rule."""

import math
from collections.abc import Sequence

import numpy as np

from app.case import TrackingFrame
from app.control import ToolKinematics
from app.fixture import FixtureRule
from app.geometry import (
    NS_PER_MS,
    NS_PER_S,
    FloatArray,
    FrameError,
    Stamp,
    TrackedTransform,
    Transform,
)
from app.planning import NeedlePath, guide_needle, needle_constraint
from app.session import Session, StepResult, TrackingError
from app.simulation import ArmState, JointVelocityCommand
from tests.doubles import simulated_message

LENGTH_MM = 120.0
WINDOW_MM, TOLERANCE_MM = 1.0, 1.5
SPEED_MM_S, ARRIVED_MM = 30.0, 0.3
REST_S = 0.5
"""The breath is held until then, and nothing moves."""

VALID_NS = 200 * NS_PER_MS
TRACKING = TrackingError(
    latency_ns=20 * NS_PER_MS,
    sigma_mm=math.hypot(0.05, 0.25) / math.sqrt(3.0),
    sigma_rad=math.radians(math.hypot(0.03, 0.05)) / math.sqrt(3.0),
)


class NeedleController:
    """Constraints from tracker frames, and joint velocities by the rule of a controller."""

    def __init__(
        self,
        path: NeedlePath,
        session: Session,
        tool: ToolKinematics,
        rule_from_base: Transform,
        is_guarded: bool,
    ) -> None:
        self._path, self._session, self._tool = path, session, tool
        self._rule_from_base, self._is_guarded = rule_from_base, is_guarded
        self._limits = self._tool.limits()
        self._rule = FixtureRule(frame=self._path.frame, accept_simulated=True)
        self._seq = 0
        self._at_rest: list[FloatArray] = []
        self._push: FloatArray = np.zeros(6)
        self.has_arrived = self.is_waiting = False

    def track(self, samples: Sequence[TrackedTransform], now_ns: int) -> None:
        """Make a constraint of a tracker frame."""
        frame = TRACKING.acquired(TrackingFrame(Stamp(now_ns), tuple(samples)))
        step = self._session.step(frame)
        planes, needle = step.decision.constraint, step.tumor_from_tip
        if planes is None or needle is None or not step.decision.constraint_is_current:
            return
        target_mm = self._target(step)
        if now_ns < REST_S * NS_PER_S:  # at end expiration
            if target_mm is not None:
                self._at_rest.append(target_mm)
            return
        if target_mm is not None:
            target_mm = self._path.target_mm + target_mm - np.mean(self._at_rest, axis=0)
        may_advance = self._path.is_target_near(target_mm, WINDOW_MM)
        joined = needle_constraint(
            self._path,
            needle,
            tolerance_mm=TOLERANCE_MM,
            may_advance=may_advance,
            guard=planes if self._is_guarded else None,
            shaft_mm=LENGTH_MM,
        )
        assert step.decision.stamp is not None
        self._seq += 1
        message = simulated_message(
            joined, step.decision.state, self._seq, step.decision.stamp.ns, VALID_NS
        )
        self._rule.receive(message, now_ns)
        to_go = self._path.target_mm - needle.translation_mm
        distance_mm = float(np.linalg.norm(to_go))
        self._push[:3] = to_go * min(SPEED_MM_S / distance_mm, 10.0)
        self.is_waiting = not may_advance
        guidance = guide_needle(self._path, needle)
        self.has_arrived = may_advance and guidance.remaining_mm < ARRIVED_MM

    def command(self, arm: ArmState, now_ns: int) -> JointVelocityCommand:
        """The velocities that the rule allows now."""
        base_from_tip, jacobian = self._tool.evaluate(arm.positions)
        turn = self._rule_from_base.rotation
        decision = self._rule.allow_joints(
            self._push,
            self._rule_from_base.apply(base_from_tip.translation_mm),
            np.concatenate([turn @ jacobian[:3], turn @ jacobian[3:]]),
            arm.positions,
            self._limits,
            now_ns,
        )
        return JointVelocityCommand(now_ns, arm.joints, tuple(decision.velocities.tolist()))

    def _target(self, step: StepResult) -> FloatArray | None:
        try:
            return step.edges.between(self._path.frame, "target")[0].translation_mm
        except FrameError:
            return None
