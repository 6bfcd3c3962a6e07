"""What a killed recorder loses: `marginguard bench record`."""
