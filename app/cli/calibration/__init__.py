"""Calibrations from a recording: the methods, their inputs and their results."""
