"""Registration and calibration beside their peers, one topic a file."""
