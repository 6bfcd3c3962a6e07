"""Hands that a person moves, for ``marginguard simulate --hand``, and the keys of the terminal."""

import contextlib
import os
import select
import sys
import termios
import threading
import time
import tty
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING

from app.geometry import InputError

if TYPE_CHECKING:
    from contextlib import AbstractContextManager

    from app.bridge import RosNode
    from app.bridge.simulation import Hand
    from app.simulation import WorldDescription


KINDS = ("keyboard", "joy", "device")

_POLL_S = 0.1


def check_terminal() -> None:
    """Raise `InputError` where the standard input is no terminal."""
    if not sys.stdin.isatty():
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


def check_hand(kind: str, description: "WorldDescription") -> None:
    """Raise `InputError` for a hand that the world or the terminal does not have."""
    if kind not in KINDS:
        return
    entry = description.hand
    if entry is None or getattr(entry, kind, True) is None:
        key = "hand" if entry is None else f"hand.{kind}"
        raise InputError(f"--hand {kind}: the world has no {key}; expected one")
    if kind == "keyboard":
        check_terminal()


def open_hand(kind: str, ros: "RosNode", description: "WorldDescription") -> "Hand | None":
    """The hand that a person moves; None for another kind. `check_hand` has passed."""
    from app.bridge.simulation import DeviceHand, JoyInput
    from app.simulation import KeyHand

    entry = description.hand
    if kind not in KINDS or entry is None:
        return None
    robot = next(each for each in description.robots if each.name == entry.robot)
    assert robot.tool is not None  # a world with a hand has it
    tool = robot.tool.name
    if kind == "joy" and entry.joy is not None:
        return JoyInput(ros, entry.joy, tool, entry.force_n).hand
    if kind == "device" and entry.device is not None:
        return DeviceHand(ros, entry.device, tool)
    return KeyHand(tool, entry.force_n, time.monotonic_ns)


def keys_to(hand: "Hand | None") -> "AbstractContextManager[None]":
    """Pass the keys of the terminal to a `KeyHand`, as long as the context lasts."""
    from app.simulation import KeyHand

    return pressed_keys(hand.press) if isinstance(hand, KeyHand) else contextlib.nullcontext()
