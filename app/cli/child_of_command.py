"""Run a command as the child of another one: ``python -m app.cli.child_of_command COMMAND ...``.

It ends with its parent: on Linux the system sends it SIGTERM when the parent has died, also by
SIGKILL.
"""

import ctypes
import os
import signal
import sys

_PR_SET_PDEATHSIG = 1


def child_of_command(*arguments: str) -> list[str]:
    """The command line of ``marginguard ARGUMENTS`` as a child of this process."""
    return [sys.executable, "-m", "app.cli.child_of_command", str(os.getpid()), *arguments]


def end_with_parent(parent: int) -> None:
    """Request SIGTERM for the death of ``parent``; exit at once if it has died already."""
    if not sys.platform.startswith("linux"):
        return
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)
    if os.getppid() != parent:
        sys.exit(128 + signal.SIGTERM)


if __name__ == "__main__":
    end_with_parent(int(sys.argv.pop(1)))
    from app.cli.main import main

    sys.exit(main())
