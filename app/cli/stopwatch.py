"""Measure the stages of a command."""

import sys
import time


class Stopwatch:
    """Consecutive laps, starting at construction."""

    def __init__(self) -> None:
        self._laps: dict[str, float] = {}
        self._last_s = time.perf_counter()

    def lap(self, name: str) -> None:
        """Add the time since the last lap to ``name``."""
        now_s = time.perf_counter()
        self._laps[name] = self._laps.get(name, 0.0) + now_s - self._last_s
        self._last_s = now_s

    def add(self, name: str, seconds: float) -> None:
        """Add a time that was measured elsewhere."""
        self._laps[name] = self._laps.get(name, 0.0) + seconds

    def print_laps(self) -> None:
        """Print seconds and name of each lap to standard error."""
        for name, seconds in self._laps.items():
            print(f"{seconds:9.3f} s  {name}", file=sys.stderr)
