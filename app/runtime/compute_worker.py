"""The process of `ComputeProcess`: ``python -m app.runtime.compute_worker DESCRIPTOR``."""

import gc
import logging
import signal
import socket
import sys
from collections.abc import Callable
from typing import cast

from app.geometry import MarginGuardError
from app.runtime.compute import receive_object, send_object

_LOG = logging.getLogger(__name__)


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


if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # of the terminal: the session ends this process
    with socket.socket(fileno=int(sys.argv[1])) as parent:
        serve(parent)
