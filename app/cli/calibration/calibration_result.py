"""Result of a calibration or registration: text, JSON, saved file, plot, exit status."""

import json
import sys
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from app.files import check_output_path, check_transform_path, write_file, write_transform
from app.geometry import FloatArray, InputError, Transform, join_transform_name

UNITS = ("mm", "deg", "ms", "s")
"""Unit suffixes of the keys of `CalibrationResult.numbers`, as in ``rms_mm``."""


@dataclass(frozen=True, slots=True, eq=False)
class Residuals:
    """The residual of each observation.

    ``what``, ``across``
        Axis labels of a plot: the quantity, and the observation it belongs to.
    ``values`` (n,)
        In ``unit``, outliers included.
    ``labels``
        Names of the observations, or empty if they are only numbered.
    ``outliers``
        Indices of observations that were not used.
    ``leave_one_out`` (n,)
        In mm, or None if it was not computed.
    """

    what: str
    unit: str
    across: str
    values: FloatArray
    labels: tuple[str, ...] = ()
    outliers: tuple[int, ...] = ()
    leave_one_out: FloatArray | None = None

    @property
    def used(self) -> FloatArray:
        """The residuals without the outliers."""
        return np.delete(self.values, self.outliers)

    @property
    def rms(self) -> float:
        """Root mean square of `used`."""
        return float(np.sqrt(np.mean(self.used**2)))

    @property
    def largest(self) -> float:
        """The largest of `used`."""
        return float(self.used.max())


@dataclass(frozen=True, slots=True, eq=False)
class CalibrationResult:
    """The result of one calibration or registration.

    ``kind``
        The method.
    ``transform``
        None for a clock offset and for an ambiguous match.
    ``accepted``, ``reason``
        Whether the result may be used, and one line that explains it.
    ``numbers``
        Values by name; the name ends with the unit.
    ``others``
        Further transforms from the same computation.
    """

    kind: str
    transform: Transform | None
    accepted: bool
    reason: str
    numbers: Mapping[str, float]
    residuals: Residuals | None = None
    others: tuple[Transform, ...] = ()
    notes: tuple[str, ...] = field(default=())

    @property
    def title(self) -> str:
        """``pivot: ToolTipToTool``."""
        return self.kind if self.transform is None else f"{self.kind}: {name_of(self.transform)}"


def name_of(transform: Transform) -> str:
    """The SlicerIGT name of the transform, as in ``ToolTipToTool``."""
    return join_transform_name(transform.source, transform.target)


def as_json(result: CalibrationResult, elapsed_s: float) -> dict[str, Any]:
    """JSON-compatible dictionary, with None for a non-finite number.

    ``elapsed_s`` is the computing time.
    """
    residuals = result.residuals
    return {
        "kind": result.kind,
        "accepted": result.accepted,
        "reason": result.reason,
        "elapsed_s": round(elapsed_s, 3),
        "transform": None if result.transform is None else _transform(result.transform),
        "others": [_transform(other) for other in result.others],
        "numbers": {name: _number(value) for name, value in result.numbers.items()},
        "residuals": None if residuals is None else _residuals(residuals),
        "notes": list(result.notes),
    }


def _transform(transform: Transform) -> dict[str, Any]:
    return {
        "name": name_of(transform),
        "target": transform.target,
        "source": transform.source,
        "matrix": transform.matrix.ravel().tolist(),
    }


def _residuals(residuals: Residuals) -> dict[str, Any]:
    leave_one_out = residuals.leave_one_out
    return {
        "what": residuals.what,
        "unit": residuals.unit,
        "values": residuals.values.tolist(),
        "labels": list(residuals.labels),
        "outliers": list(residuals.outliers),
        "leave_one_out_mm": (
            None if leave_one_out is None else [_number(x) for x in leave_one_out.tolist()]
        ),
    }


def _number(value: float) -> float | None:
    return value if np.isfinite(value) else None


def as_text(result: CalibrationResult, elapsed_s: float) -> str:
    """Human-readable text in aligned lines; ``elapsed_s`` is the computing time."""
    verdict = "accepted" if result.accepted else "NOT ACCEPTED"
    lines = [f"{result.title}  {verdict}", _line("reason", result.reason)]
    for transform in (result.transform, *result.others):
        if transform is not None:
            lines += _matrix_lines(transform, "matrix" if transform is result.transform else "")
    lines += [_line(*_label_and_value(name, value)) for name, value in result.numbers.items()]
    if result.residuals is not None and result.residuals.labels:
        lines += _table(result.residuals)
    lines += [_line("note", note) for note in result.notes]
    lines.append(_line("time", f"{elapsed_s:.2f} s to read the recording and compute the result"))
    return "\n".join(lines)


def _line(label: str, text: str) -> str:
    return f"  {label:<18} {text}"


def _matrix_lines(transform: Transform, label: str) -> list[str]:
    rows = ["".join(f"{value:13.6f}" for value in row) for row in transform.matrix]
    return [
        _line((label or name_of(transform)) if n == 0 else "", row) for n, row in enumerate(rows)
    ]


def _label_and_value(name: str, value: float) -> tuple[str, str]:
    label, _, unit = name.rpartition("_")
    if unit not in UNITS:
        label, unit = name, ""
    text = f"{value:d}" if isinstance(value, int) else f"{value:.4g}"
    return label.replace("_", " "), f"{text} {unit}".rstrip()


def _table(residuals: Residuals) -> list[str]:
    lines = []
    for index, (label, value) in enumerate(zip(residuals.labels, residuals.values, strict=True)):
        text = f"{value:8.3f} {residuals.unit}"
        if residuals.leave_one_out is not None and np.isfinite(residuals.leave_one_out[index]):
            text += f"   left out {residuals.leave_one_out[index]:8.3f} mm"
        if index in residuals.outliers:
            text += "   dropped"
        lines.append(_line(f"residual {label}", text))
    return lines


NOT_ACCEPTED = 1
_YAML = (".yaml", ".yml")


def check_outputs(save: Path | None, plot: Path | None, *, clock_offset: bool = False) -> None:
    """Raise `InputError` for paths that cannot be written, before the calibration runs.

    ``clock_offset``: a clock offset will be saved instead of a transform.
    """
    if save is not None and clock_offset:
        if save.suffix.lower() not in _YAML:
            raise InputError(
                f"{save}: wrong file type for a clock offset; expected {' or '.join(_YAML)}"
            )
        check_output_path(save)
    elif save is not None:
        check_transform_path(save)
    if plot is not None:
        if plot.suffix.lower() != ".png":
            raise InputError(f"{plot}: wrong file type for a plot; expected .png")
        check_output_path(plot)


def write_outputs(
    result: CalibrationResult,
    elapsed_s: float,
    *,
    as_json_text: bool,
    save: Path | None,
    plot: Path | None,
) -> int:
    """Print the result, draw its residuals, save it if accepted. Returns the exit status."""
    if as_json_text:
        print(json.dumps(as_json(result, elapsed_s), indent=2, allow_nan=False))
    else:
        print(as_text(result, elapsed_s))
    if plot is not None:
        _draw(result, plot)
    if not result.accepted:
        if save is not None:
            print(f"{save} is not written: not accepted", file=sys.stderr)
        return NOT_ACCEPTED
    if save is not None:
        _save(result, save)
    return 0


def _save(result: CalibrationResult, path: Path) -> None:
    note = f"{result.kind}: {result.reason}"
    if result.transform is not None:
        write_transform(path, result.transform, note)
        return
    # The form of the `clock` entry of a case.yaml; an offset of other clocks has no such entry.
    key = "offset_robot_to_tracker_ms"
    numbers = result.numbers
    values = (
        {"clock": {key: numbers[key]}}
        if key in numbers
        else {name: value for name, value in numbers.items() if name.endswith("_ms")}
    )
    text = yaml.safe_dump(values)
    write_file(path, f"# {note}\n{text}".encode())


def _draw(result: CalibrationResult, path: Path) -> None:
    residuals = result.residuals
    if residuals is None or not len(residuals.values):
        print(f"{path} is not written: there are no residuals", file=sys.stderr)
        return
    from app.report.margin_plot import residual_png

    verdict = "accepted" if result.accepted else "not accepted"
    picture = residual_png(
        residuals.values,
        title=f"{result.title} ({verdict})",
        what=residuals.what,
        unit=residuals.unit,
        across=residuals.across,
        labels=residuals.labels,
        outliers=residuals.outliers,
    )
    write_file(path, picture)
