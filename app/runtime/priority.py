"""Priority of the processes that work for a command."""

import os
import subprocess
from contextlib import suppress

_NICENESS = 5
"""Low enough for the thread of the constraint to go first, high enough to proceed beside others."""


def step_back() -> None:
    """Let this process give way to others that start with its present priority."""
    os.nice(_NICENESS)


def work_behind(process: "subprocess.Popen[bytes]") -> None:
    """Let the new ``process`` give way to this one."""
    with suppress(ProcessLookupError):  # it has ended: its user reports that
        os.setpriority(os.PRIO_PROCESS, process.pid, os.nice(0) + _NICENESS)
