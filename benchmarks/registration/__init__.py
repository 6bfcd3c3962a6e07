"""Benchmark of registration and calibration against other implementations, one topic per file."""
