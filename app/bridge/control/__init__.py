"""Control: the constraint at 1 kHz, the allowed twist, the guidance, and what changes a session."""

from app.bridge.control.allowed_twist import TwistLimiter
from app.bridge.control.constraint_stream import ConstraintStream
from app.bridge.control.guidance_wrench import GuidancePublisher
from app.bridge.control.lifecycle import LifecycleRosNode, Managed
from app.bridge.control.margin_parameters import MarginParameterServer
from app.bridge.control.operator_services import OperatorServices

__all__ = [
    "ConstraintStream",
    "GuidancePublisher",
    "LifecycleRosNode",
    "Managed",
    "MarginParameterServer",
    "OperatorServices",
    "TwistLimiter",
]
