"""Where the time of a command went."""

import sys
import time


class Stopwatch:
    """Laps one after the other, from construction on."""

    def __init__(self) -> None:
        self._laps: dict[str, float] = {}
        self._last_s = time.perf_counter()

    def lap(self, name: str) -> None:
        """What has been done since the last lap is ``name``."""
        now_s = time.perf_counter()
        self._laps[name] = now_s - self._last_s
        self._last_s = now_s

    def tell(self) -> None:
        """A line a lap on standard error: seconds, name."""
        for name, seconds in self._laps.items():
            print(f"{seconds:9.3f} s  {name}", file=sys.stderr)
