"""The JSON of ``marginguard plan approach``, read for its execution."""

from pathlib import Path
from typing import Any

import numpy as np

from app.control.path_follower import PlannedMotion
from app.files.json_file import parse_json, read_json
from app.geometry import InputError

_MAX_BYTES = 64_000_000


def read_plan(path: Path) -> PlannedMotion:
    """Read the plan at ``path``. Raises `InputError` for the first fault."""
    return _motion(read_json(path, _MAX_BYTES), str(path))


def parse_plan(text: str) -> PlannedMotion:
    """The plan in ``text``, which a node has received. Raises `InputError` for the first fault."""
    if len(text) > _MAX_BYTES:
        raise InputError(f"plan: has {len(text)} characters; expected at most {_MAX_BYTES}")
    return _motion(parse_json(text, "plan"), "plan")


def _motion(values: Any, place: str) -> PlannedMotion:
    try:
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
    except InputError as error:
        raise InputError(f"{place}: {error}") from error
    except (KeyError, TypeError, ValueError, AttributeError, OverflowError) as error:
        raise InputError(
            f"{place}: is not a plan ({type(error).__name__}: {error}); expected the JSON of "
            "'marginguard plan approach'"
        ) from error


def _text(value: Any) -> str:
    if not isinstance(value, str):
        raise TypeError(f"{value!r} is no text")
    return value
