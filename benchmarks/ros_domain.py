"""A ROS domain of this machine that no test and no other benchmark uses."""

import fcntl
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

MAX_DOMAIN = 100  # the ports of domains above 101 are in the ephemeral range of Linux


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


@contextmanager
def own_ros(folder: Path | None = None) -> Iterator[Path]:
    """Reserve a domain for this process and its children, before ROS is loaded.

    Yields ``folder``, by default a temporary one, in which a session also keeps its state. Other
    ROS traffic of the machine stays out of the figures.
    """
    from app.bridge.environment import prepare_environment

    with reserved_domain() as domain, tempfile.TemporaryDirectory() as temporary:
        folder = folder or Path(temporary)
        folder.mkdir(parents=True, exist_ok=True)
        os.environ["ROS_DOMAIN_ID"] = str(domain)
        os.environ["XDG_STATE_HOME"] = str(folder / "state")
        prepare_environment()
        yield folder
