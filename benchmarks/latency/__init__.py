"""Latency from a stamp in another process to the scene: `marginguard bench latency`."""
