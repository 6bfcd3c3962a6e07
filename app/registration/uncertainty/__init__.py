"""Uncertainty of a registration: its result, predicted errors, acceptance and drift."""
