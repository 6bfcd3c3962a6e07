"""Delay of live ultrasound images up to the page: `marginguard bench images`."""
