"""Tracker frames in the order of their acquisition: put together, watched, counted and played."""
