"""Values that all parts of the API use, checks of arguments, and errors for missing packages."""

import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

from app.files.extras import install_hint
from app.geometry import InputError, MarginGuardError, Transform

__all__ = ["InputError", "MarginGuardError", "Transform"]

Value = TypeVar("Value")


def as_path(value: str | os.PathLike[str], name: str) -> Path:
    """``value`` as a path; raises `InputError` for another type and for an empty text."""
    if not isinstance(value, str | os.PathLike) or not isinstance(os.fspath(value), str):
        raise InputError(f"{name}: is {described(value)}; expected a path as str or Path")
    if not os.fspath(value):
        raise InputError(f"{name}: is empty; expected a path")
    return Path(value)


def checked(value: object, kind: type[Value], name: str, hint: str = "") -> Value:
    """``value`` if it is a ``kind``; raises `InputError` otherwise, with ``hint`` at the end."""
    if not isinstance(value, kind):
        raise InputError(f"{name}: is {described(value)}; expected a {kind.__name__}{hint}")
    return value


def checked_list(
    values: Iterable[Any], kind: type[Value], name: str, hint: str = ""
) -> list[Value]:
    """``values`` as a list of ``kind``; raises `InputError` for the first one of another type."""
    checked_iterable(values, name, f"several {kind.__name__}{hint}")
    return [checked(value, kind, f"{name}[{index}]", hint) for index, value in enumerate(values)]


def checked_iterable(values: Iterable[Value], name: str, expected: str) -> Iterable[Value]:
    """``values`` if it can be iterated and is no text; raises `InputError` otherwise."""
    if isinstance(values, str) or not isinstance(values, Iterable):
        raise InputError(f"{name}: is {described(values)}; expected {expected}")
    return values


@contextmanager
def needs(what: str) -> Iterator[None]:
    """Report a failed import in the ``with`` block as an `InputError` that names the remedy."""
    try:
        yield
    except ImportError as error:
        raise InputError(f"{what} cannot be loaded ({error}): {install_hint(error)}") from error


def described(value: object) -> str:
    """``value`` and its type, in one line for messages."""
    text = " ".join(repr(value).split())
    shown = text if len(text) <= 60 else f"{text[:57]}..."
    return f"{shown} ({type(value).__name__})"
