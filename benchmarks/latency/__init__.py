"""From a stamp in another process to the models of the scene: `marginguard bench latency`."""
