"""Control interface: allowed twist, guidance wrench, lifecycle, margins and operator services."""

from app.bridge.control.allowed_twist import TwistLimiter
from app.bridge.control.guidance_wrench import GuidancePublisher
from app.bridge.control.lifecycle import LifecycleRosNode, Managed
from app.bridge.control.margin_parameters import MarginParameterServer
from app.bridge.control.operator_services import OperatorServices

__all__ = [
    "GuidancePublisher",
    "LifecycleRosNode",
    "Managed",
    "MarginParameterServer",
    "OperatorServices",
    "TwistLimiter",
]
