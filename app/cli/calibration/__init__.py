"""Calibrations from a recording: one method a file, one form for what each of them finds."""
