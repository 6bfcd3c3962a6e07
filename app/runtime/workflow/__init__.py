"""Guided calibration of a session's tool. Reads no clock: the steps carry the time."""
