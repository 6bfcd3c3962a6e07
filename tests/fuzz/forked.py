"""Parsers of xacro and HDF5 in a forked child, which starts in 5 ms instead of 250 ms.

The parser starts a new interpreter, because a program with threads must not fork. The code and
the limits of the child are the same.
"""

import os
from collections.abc import Callable


def start_forked(request: bytes) -> tuple[int, bytes]:
    """Answer ``request`` in a forked child; see `app.files.child_process.Ask`."""
    from app.robot.xacro_child import answer  # slow to load

    return _forked(answer, request)


def start_forked_hdf5(request: bytes) -> tuple[int, bytes]:
    """Answer ``request`` in a forked child; see `app.files.child_process.Ask`."""
    from app.files.hdf5_child import answers  # slow to load

    return _forked(lambda content: b"".join(answers(content)), request)


def _forked(answer: Callable[[bytes], bytes], request: bytes) -> tuple[int, bytes]:
    readable, writable = os.pipe()
    child = os.fork()
    if child == 0:
        null = os.open(os.devnull, os.O_WRONLY)
        for standard, own in enumerate((null, null, writable), start=1):
            os.dup2(own, standard)
        # The connection of the worker ends with the worker, not with its children.
        os.closerange(4, os.sysconf("SC_OPEN_MAX"))
        os.write(3, answer(request))
        os._exit(0)
    os.close(writable)
    with os.fdopen(readable, "rb") as reply:
        content = reply.read()
    _, status = os.waitpid(child, 0)
    return os.waitstatus_to_exitcode(status), content
