"""A cooperative controller on the graph, between a hand and an arm with CRTK's topics."""

from app.bridge.arm_control.control_node import NODE_NAME, ControlNode

__all__ = ["NODE_NAME", "ControlNode"]
