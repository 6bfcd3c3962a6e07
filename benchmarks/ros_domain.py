"""A ROS domain of this machine that no test and no other benchmark uses."""

import fcntl
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

MAX_DOMAIN = 100
"""The ports of domains above 101 are in the ephemeral range of Linux."""


@contextmanager
def reserved_domain() -> Iterator[int]:
    """Reserve a domain by locking a file; the system releases the lock of a dead process.

    Raises `RuntimeError` if all are in use.
    """
    for offset in range(MAX_DOMAIN):
        domain = 1 + (os.getpid() + offset) % MAX_DOMAIN
        path = Path(tempfile.gettempdir()) / f"marginguard-ros-domain-{domain}.lock"
        with path.open("w") as lock:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                continue
            yield domain
            return
    raise RuntimeError(f"all ROS domains from 1 to {MAX_DOMAIN} are reserved on this machine")
