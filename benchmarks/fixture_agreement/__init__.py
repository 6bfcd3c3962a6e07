"""Agreement of the fixture's signs, distances and sweeps with an independent oracle."""
