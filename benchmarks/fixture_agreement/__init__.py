"""The fixture's signs, distances and sweeps against an independent judge."""
