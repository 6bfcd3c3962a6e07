"""Control interface: allowed twist, lifecycle, margins and operator services."""

from app.bridge.control.allowed_twist import TwistLimiter
from app.bridge.control.lifecycle import LifecycleRosNode, Managed
from app.bridge.control.operator_requests import MarginParameterServer
from app.bridge.control.operator_services import OperatorServices

__all__ = [
    "LifecycleRosNode",
    "Managed",
    "MarginParameterServer",
    "OperatorServices",
    "TwistLimiter",
]
