"""Tracker frames in the order of acquisition: assembled, checked for gaps, counted, played."""
