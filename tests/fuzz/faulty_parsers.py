"""Parsers with one fault each, and two without, for tests of the fuzzer."""

import os
import signal
import sys
import time
from pathlib import Path

from app.geometry import InputError
from tests.fuzz.mutators.raw import RAW
from tests.fuzz.parser import FuzzedParser


class TwoLinesError(InputError):
    def __str__(self) -> str:
        return f"{super().__str__()}:\nis wrong"


def accepts(path: Path) -> bytes:
    return path.read_bytes()


def refuses(path: Path) -> None:
    raise InputError(f"{path} is not a file of numbers")


def untyped(path: Path) -> None:
    raise KeyError(path.name)


def unnamed(_: Path) -> None:
    raise InputError("something is wrong")


def lines(path: Path) -> None:
    raise TwoLinesError(str(path))


def printed(_: Path) -> None:
    print("a library says this", file=sys.stderr)


def memory(_: Path) -> None:
    bytearray(b"x") * (5 << 28)


def crash(_: Path) -> None:
    os.kill(os.getpid(), signal.SIGSEGV)


def spins(_: Path) -> None:
    while True:
        pass


def blocks(_: Path) -> None:
    time.sleep(3600)


PARSERS = {
    parse.__name__: FuzzedParser("file.bin", parse, lambda: [b"seed"], RAW)
    for parse in (
        *(accepts, refuses, untyped, unnamed, lines, printed, memory, crash),
        *(spins, blocks),
    )
}
