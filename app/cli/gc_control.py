"""Control of the garbage collector, and of the threads of a process that has to react at once."""

import gc
import inspect
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Self

_THRESHOLD = 50_000
"""New objects between two collections. Each block of frames that is read ahead
(`app.case.frame_streams.read_ahead`) allocates a thousand and soon frees them."""


class GcPause:
    """Within the context collection is off until `settle`, and then covers newer objects only.

    Loading allocates a million objects, nearly all of which stay until the end.
    """

    def __enter__(self) -> Self:
        self._enabled, self._thresholds = gc.isenabled(), gc.get_threshold()
        gc.disable()
        return self

    def settle(self) -> None:
        """Freeze all present objects until the end of the context; call it when all is loaded."""
        gc.freeze()
        gc.set_threshold(_THRESHOLD, *self._thresholds[1:])
        self._restore_enabled()

    def __exit__(self, *_: object) -> None:
        gc.unfreeze()
        gc.set_threshold(*self._thresholds)
        self._restore_enabled()

    def _restore_enabled(self) -> None:
        if self._enabled:
            gc.enable()


@contextmanager
def prompt_process() -> Iterator[None]:
    """Within the context no thread waits long for another one, and collections are short.

    A full garbage collection of what a command loads takes about half a second, in which no thread
    runs: it is done here, and those objects are frozen. So enter it when all is loaded, and before
    anything is received. A computing thread keeps the interpreter lock for `SWITCH_INTERVAL_S` at
    most instead of 5 ms. rclpy finds the caller of a log message by `inspect`, which looks at the
    files of all modules once, for 0.1 s: here.
    """
    from app.runtime import SWITCH_INTERVAL_S  # slow to load, for a child that does not need it

    inspect.getmodule(inspect.currentframe())
    switch_s = sys.getswitchinterval()
    gc.collect()
    gc.freeze()
    sys.setswitchinterval(min(switch_s, SWITCH_INTERVAL_S))
    try:
        yield
    finally:
        sys.setswitchinterval(switch_s)
        gc.unfreeze()
