"""Topics and services of a live node for displays, and the client that displays use."""

from app.bridge.displays.live_child import LiveChild
from app.bridge.displays.planning_client import ApproachRequest, ExecutedPlan
from app.bridge.displays.session_client import SessionClient

__all__ = ["ApproachRequest", "ExecutedPlan", "LiveChild", "SessionClient"]
