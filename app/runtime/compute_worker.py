"""The process of `ComputeProcess`: ``python -m app.runtime.compute_worker DESCRIPTOR``."""

import gc
import logging
import os
import signal
import socket
import sys
from collections.abc import Callable
from typing import cast

import numpy as np

from app.fixture import prepared_tumor
from app.geometry import MarginGuardError, SurfaceMesh
from app.runtime.compute import receive_object, send_object
from app.session import tumor_change

_LOG = logging.getLogger(__name__)

_NICENESS = 5
"""Low enough for the thread of the constraint to go first, high enough to proceed beside others."""


def serve(connection: socket.socket) -> None:
    """Answer the calls that arrive on ``connection`` until it is closed."""
    while (request := receive_object(connection)) is not None:
        function, args = cast(tuple[Callable[..., object], tuple[object, ...]], request)
        reply: tuple[bool, object]
        try:
            reply = (True, function(*args))
        except MarginGuardError as error:
            reply = (False, error)
        except Exception as error:  # the caller reports any failure, and the next call follows
            _LOG.exception("%s failed", function)
            reply = (False, RuntimeError(f"{type(error).__name__}: {error}"))
        send_object(connection, reply)
        del request, args, reply
        gc.collect()


def _warm_up() -> None:
    """Load the compiled functions, which takes longer than the smallest tumour."""
    vertices = np.array([[0.0, 0, 0], [9, 0, 0], [0, 9, 0], [0, 0, 9]])
    mesh = SurfaceMesh("tumor", vertices, np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]))
    prepared_tumor(mesh, 100)
    tumor_change(mesh, mesh)


if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # of the terminal: the session ends this process
    os.nice(_NICENESS)
    with socket.socket(fileno=int(sys.argv[1])) as parent:
        _warm_up()
        serve(parent)
