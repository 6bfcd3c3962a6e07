"""Guided calibration and registration, and the steps of a case. Reads no clock."""
