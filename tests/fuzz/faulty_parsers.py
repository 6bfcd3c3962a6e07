"""Parsers with one fault each, and one without, for tests of the fuzzer."""

import os
import signal
import sys
import time
from pathlib import Path

from app.geometry import InputError
from benchmarks.fuzz.mutators.raw import RAW
from benchmarks.fuzz.parser import FuzzedParser


def _accept(path: Path) -> bytes:
    return path.read_bytes()


def _refuse(path: Path) -> None:
    raise InputError(f"{path} is not a file of numbers")


def _raise(path: Path) -> None:
    raise KeyError(path.name)


def _print(_: Path) -> None:
    print("a library says this", file=sys.stderr)


def _spin(path: Path) -> None:
    while path.read_bytes() == b"seed":
        pass


def _block(path: Path) -> None:
    if path.read_bytes() == b"seed":
        time.sleep(60)


def _fill(_: Path) -> None:
    bytearray(os.urandom(1)) * (3 << 29)


def _die(_: Path) -> None:
    os.kill(os.getpid(), signal.SIGSEGV)


def _unnamed(_: Path) -> None:
    raise InputError("something is wrong")


def _parser(name, parse) -> FuzzedParser:  # type: ignore[no-untyped-def]
    return FuzzedParser(name, "file.bin", parse, lambda: [b"seed"], RAW)


PARSERS = (
    _parser("accepts", _accept),
    _parser("refuses", _refuse),
    _parser("raises", _raise),
    _parser("prints", _print),
    _parser("spins", _spin),
    _parser("blocks", _block),
    _parser("fills", _fill),
    _parser("dies", _die),
    _parser("unnamed", _unnamed),
)
