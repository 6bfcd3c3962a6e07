"""The JSON of ``marginguard plan approach``, read for its execution and for displays."""

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from app.control.path_follower import PlannedMotion
from app.files.json_file import parse_json, read_json
from app.geometry import InputError

_MAX_BYTES = 64_000_000
_MAX_PLACES = 81
"""Times that are shown of a plan that names none."""
_Read = TypeVar("_Read")


@dataclass(frozen=True, slots=True, eq=False)
class ShownPlan:
    """A plan as displays show it: ``motion`` at its samples ``samples`` (k,).

    ``nearest`` (k) are the nearest structure there and its distance in mm from the robot; empty
    where no structure is tested, None in a plan without distances. ``clearance_mm`` is proven for
    the whole way.
    """

    motion: PlannedMotion
    samples: NDArray[np.intp]
    nearest: tuple[tuple[str, float], ...] | None
    clearance_mm: float


def read_plan(path: Path) -> str:
    """Read the plan at ``path`` and return its JSON. Raises `InputError` for the first fault."""
    values = read_json(path, _MAX_BYTES)
    _checked(_motion, values, str(path))
    return json.dumps(values)


def read_shown_plan(path: Path) -> ShownPlan:
    """Read the plan at ``path`` for a display. Raises `InputError` for the first fault."""
    return _checked(_shown_plan, read_json(path, _MAX_BYTES), str(path))


def parse_plan(text: str) -> PlannedMotion:
    """The plan in ``text``, which a node has received. Raises `InputError` for the first fault."""
    return _checked(_motion, _parsed(text), "plan")


def parse_shown_plan(text: str) -> ShownPlan:
    """The plan in ``text``, for a display. Raises `InputError` for the first fault."""
    return _checked(_shown_plan, _parsed(text), "plan")


def _parsed(text: str) -> Any:
    if len(text) > _MAX_BYTES:
        raise InputError(f"plan: has {len(text)} characters; expected at most {_MAX_BYTES}")
    return parse_json(text, "plan")


def _checked(read: Callable[[Any], _Read], values: Any, place: str) -> _Read:
    try:
        return read(values)
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


def _shown_plan(values: Any) -> ShownPlan:
    motion, preview = _motion(values), values.get("preview")
    clearance_mm = float(values["clearance_mm"])
    if not np.isfinite(clearance_mm):
        raise ValueError("clearance_mm is not finite")
    last = len(motion.times_ns) - 1
    if preview is None:
        places = np.linspace(0, last, min(last + 1, _MAX_PLACES))
        return ShownPlan(motion, np.unique(places.round().astype(np.intp)), None, clearance_mm)
    samples = np.array(preview["samples"])
    nearest = tuple((_text(name), float(mm)) for name, mm in preview["nearest"])
    count = samples.size
    if samples.dtype != np.int64 or samples.ndim != 1 or (np.diff(samples) <= 0).any():
        raise TypeError("samples of the preview are no increasing integers")
    if count == 0 or samples[0] < 0 or samples[-1] > last or len(nearest) not in (0, count):
        raise ValueError(
            f"preview has {count} samples of 0 to {last}, and {len(nearest)} distances"
        )
    if not np.isfinite([mm for _, mm in nearest]).all():
        raise ValueError("a distance is not finite")
    return ShownPlan(motion, samples, nearest, clearance_mm)


def _text(value: Any) -> str:
    if not isinstance(value, str):
        raise TypeError(f"{value!r} is no text")
    return value
