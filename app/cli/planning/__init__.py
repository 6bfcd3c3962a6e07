"""Plans of ``marginguard plan``, one module each."""
