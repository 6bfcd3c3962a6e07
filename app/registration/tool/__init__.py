"""Calibration of a tracked tool: its tip and its shaft."""
