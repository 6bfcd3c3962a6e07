"""Registered parsers, by package of `app`."""
