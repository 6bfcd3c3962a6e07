"""Keys of the terminal, one by one, in a thread."""

import contextlib
import os
import select
import sys
import termios
import threading
import tty
from collections.abc import Callable, Iterator

_POLL_S = 0.1


def check_terminal() -> None:
    """Raise `InputError` where the standard input is no terminal."""
    if not sys.stdin.isatty():
        from app.geometry import InputError

        raise InputError("--hand keyboard: the standard input is no terminal; expected one")


@contextlib.contextmanager
def pressed_keys(press: Callable[[str], None]) -> Iterator[None]:
    """Call ``press`` for each key until the context ends, which restores the terminal.

    Ctrl-C stays a signal. Raises `InputError` where the standard input is no terminal.
    """
    check_terminal()
    number = sys.stdin.fileno()
    before = termios.tcgetattr(number)
    stop = threading.Event()

    def read() -> None:
        while not stop.is_set():
            if select.select([number], [], [], _POLL_S)[0]:
                data = os.read(number, 1)
                if not data:
                    return
                press(data.decode("ascii", "replace"))

    reader = threading.Thread(target=read, name="keys", daemon=True)
    tty.setcbreak(number)
    try:
        reader.start()
        yield
    finally:
        stop.set()
        reader.join()
        termios.tcsetattr(number, termios.TCSADRAIN, before)
