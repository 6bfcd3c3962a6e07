"""Publish ``~/guidance_wrench``: the guidance force at the tool's tip, along the tip's axes."""

import numpy as np
from geometry_msgs.msg import WrenchStamped

from app.bridge import messages, topics
from app.bridge.node import RosNode
from app.fixture import Guidance, GuidanceParameters
from app.geometry import NS_PER_S, FloatArray, Stamp, Transform
from app.session import StepResult


class GuidancePublisher:
    """Publishes one wrench per step: N and N m in the tip's frame, stamp of the oldest sample.

    If the tool's pose is unknown, or the planes belong to another pose, the force fades out at
    its limited rate. A step that is later than the period for which the stiffness is passive
    changes the force by no more than one period allows.
    """

    def __init__(self, ros: RosNode, parameters: GuidanceParameters) -> None:
        self._parameters = parameters
        self._guidance = Guidance(parameters)
        self._max_step_ns = max(1, round(parameters.period_s * NS_PER_S))
        self._pose: Transform | None = None
        self._last: Stamp | None = None
        self._publisher = ros.publisher(topics.GUIDANCE_WRENCH)

    def publish(self, step: StepResult) -> None:
        """Publish the wrench of ``step``; publishes nothing before the tool's first pose."""
        now, last = step.frame.stamp, self._last
        self._last = now
        decision, constraint = step.decision, None
        if step.tumor_from_tip is not None:
            self._pose = step.tumor_from_tip
            constraint = decision.constraint if decision.constraint_is_current else None
        if self._pose is None:
            return
        step_ns = self._max_step_ns if last is None else last.age_ns(now)
        wrench = self._guidance.update(
            constraint, self._pose.translation_mm, min(max(1, step_ns), self._max_step_ns)
        )
        self._send(self._pose, wrench, decision.stamp or now)

    def stop(self) -> None:
        """Publish a zero wrench, because no step follows that would let the force fade out."""
        self._guidance = Guidance(self._parameters)
        if self._pose is not None and self._last is not None:
            self._send(self._pose, np.zeros(6), self._last)

    def _send(self, pose: Transform, wrench: FloatArray, stamp: Stamp) -> None:
        """Publish ``wrench`` (6,), given along the tumour's axes, along those of the tip."""
        tip_from_tumor = pose.rotation.T
        message = WrenchStamped(header=messages.header_message(pose.source, stamp))
        message.wrench.force = messages.vector_message(np.dot(tip_from_tumor, wrench[:3]))
        message.wrench.torque = messages.vector_message(np.dot(tip_from_tumor, wrench[3:]))
        self._publisher.publish(message)
