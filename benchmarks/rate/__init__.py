"""The constraint at 1 kHz to another process: `marginguard bench rate`."""
