"""Pushes in separate processes over ROS in real time, and processes that fail meanwhile."""
