"""Settings of a process that has to react within milliseconds for as long as it runs."""

import gc
import inspect
import sys
from collections.abc import Iterator
from contextlib import contextmanager

from app.runtime import SWITCH_INTERVAL_S


@contextmanager
def prompt_process() -> Iterator[None]:
    """Within the context no thread waits long for another one, and collections are short.

    A full garbage collection of what a command loads takes about half a second, in which no thread
    runs: it is done here, and those objects are frozen. So enter it when all is loaded, and before
    anything is received. A computing thread keeps the interpreter lock for `SWITCH_INTERVAL_S` at
    most instead of 5 ms. rclpy finds the caller of a log message by `inspect`, which looks at the
    files of all modules once, for 0.1 s: here.
    """
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
