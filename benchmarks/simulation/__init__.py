"""Time of a physics step of a world: `marginguard bench simulation`."""
