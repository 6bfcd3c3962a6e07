"""Parsers of xacro and HDF5 in a forked child, which starts in 5 ms instead of 250 ms.

The parser starts a new interpreter, because a program with threads must not fork. The code and
the limits of the child are the same.
"""

import os
from collections.abc import Callable
from pathlib import Path

waited_ns = 0
"""Time for which children that have ended waited for a processor."""


def start_forked(request: bytes) -> tuple[int, bytes]:
    """Answer ``request`` in a forked child; see `app.robot.description.xacro_file.Start`."""
    from app.robot.description.xacro_child import answer  # slow to load

    return _forked(answer, request)


def start_forked_hdf5(request: bytes) -> tuple[int, bytes]:
    """Answer ``request`` in a forked child; see `app.files.hdf5_transforms.Start`."""
    from app.files.hdf5_child import answers  # slow to load

    return _forked(lambda content: b"".join(answers(content)), request)


def _forked(answer: Callable[[bytes], bytes], request: bytes) -> tuple[int, bytes]:
    global waited_ns
    readable, writable = os.pipe()
    child = os.fork()
    if child == 0:
        os.close(readable)
        null = os.open(os.devnull, os.O_WRONLY)
        os.dup2(null, 1)
        os.dup2(null, 2)
        with os.fdopen(writable, "wb") as output:
            output.write(answer(request))
        os._exit(0)
    os.close(writable)
    with os.fdopen(readable, "rb") as reply:
        content = reply.read()
    os.waitid(os.P_PID, child, os.WEXITED | os.WNOWAIT)
    waited_ns += scheduler_wait_ns(child)
    _, status = os.waitpid(child, 0)
    return os.waitstatus_to_exitcode(status), content


def scheduler_wait_ns(process: int | str) -> int:
    """Time that a process has waited for a processor, 0 where the kernel does not count it."""
    try:
        return int(Path(f"/proc/{process}/schedstat").read_text().split()[1])
    except (OSError, IndexError, ValueError):
        return 0
