"""Faults injected into a live session from outside, and what a controller receives meanwhile."""
