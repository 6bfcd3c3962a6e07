"""What a live node offers to displays, and the client that they use."""

from app.bridge.displays.live_child import LiveChild
from app.bridge.displays.session_client import SessionClient

__all__ = ["LiveChild", "SessionClient"]
