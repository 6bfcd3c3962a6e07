"""The JSON of ``marginguard plan approach``, read for its execution and for displays."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from app.control.path_follower import PlannedMotion
from app.files.bounded_io import read_bounded
from app.files.json_file import parse_json
from app.geometry import InputError

_MAX_BYTES = 64_000_000


class Plan(NamedTuple):
    """The motion of a plan, its JSON, and the values of that."""

    motion: PlannedMotion
    text: str
    values: Any


def read_plan(path: Path) -> Plan:
    """Read the plan at ``path``. Raises `InputError` for the first fault."""
    content = read_bounded(path, _MAX_BYTES)
    try:
        return parse_plan(content.decode(), str(path))
    except UnicodeDecodeError as error:
        raise InputError(f"{path} is not JSON: {error}") from error


def parse_plan(text: str, place: str = "plan") -> Plan:
    """The plan in ``text``, which ``place`` names. Raises `InputError` for the first fault."""
    if len(text) > _MAX_BYTES:
        raise InputError(f"{place}: has {len(text)} characters; expected at most {_MAX_BYTES}")
    values = parse_json(text, place)
    with named_faults(place):
        return Plan(_motion(values), text, values)


@contextmanager
def named_faults(place: str) -> Iterator[None]:
    """Name ``place`` in the `InputError` that each fault of a plan's values raises."""
    try:
        yield
    except InputError as error:
        raise InputError(f"{place}: {error}") from error
    except (KeyError, TypeError, ValueError, AttributeError, OverflowError) as error:
        raise InputError(
            f"{place}: is not a plan ({type(error).__name__}: {error}); expected the JSON of "
            "'marginguard plan approach'"
        ) from error


def _motion(values: Any) -> PlannedMotion:
    times_ns = np.array(values["times_ns"])
    limits = values["limits"]
    if times_ns.dtype != np.int64:
        raise TypeError("times_ns are no integers")
    return PlannedMotion(
        _text(values["robot"]),
        tuple(map(_text, values["joints"])),
        {_text(name): float(value) for name, value in values["held"].items()},
        times_ns,
        np.array(values["positions"], dtype=np.float64),
        np.array(values["velocities"], dtype=np.float64),
        np.array([float(limits[name]["acceleration"]) for name in values["joints"]]),
        _text(values["made_from"].get("setup_id", "")),
    )


def _text(value: Any) -> str:
    if not isinstance(value, str):
        raise TypeError(f"{value!r} is no text")
    return value
