"""Duration of a replay and of its results: `marginguard bench replay`."""
