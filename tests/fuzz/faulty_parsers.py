"""Parsers with one fault each, and one without, for tests of the fuzzer."""

import os
import signal
import sys
import time
from pathlib import Path
from random import Random

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
    bytearray(b"x") * (5 << 28)


def _die(_: Path) -> None:
    os.kill(os.getpid(), signal.SIGSEGV)


def _unnamed(_: Path) -> None:
    raise InputError("something is wrong")


def _die_at_first(path: Path) -> None:
    if path.read_bytes() == b"seed":
        os.kill(os.getpid(), signal.SIGSEGV)


def _no_seeds() -> list[bytes]:
    raise OSError("no seeds")


def _raising(data: bytes, _: Random) -> bytes:
    raise UnicodeDecodeError("utf-8", data, 0, 1, "invalid")


def _filling(data: bytes, _: Random) -> bytes:
    bytearray(b"x") * (5 << 28)
    return data


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
    _parser("dies_at_first", _die_at_first),
    FuzzedParser("has_no_seeds", "file.bin", _accept, _no_seeds, RAW),
    FuzzedParser("mutator_fills", "file.bin", _accept, lambda: [b"seed"], (_filling,)),
    FuzzedParser("mutator_raises", "file.bin", _accept, lambda: [b"seed"], (_raising,)),
)
