"""What a calibration or a registration found, in the one form that is printed, saved and drawn."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from app.geometry import FloatArray, Transform, join_transform_name

UNITS = ("mm", "deg", "ms", "s")
"""Endings of the names of numbers: ``rms_mm``."""


@dataclass(frozen=True, slots=True, eq=False)
class Residuals:
    """What is left at each observation.

    ``values`` (n,) in ``unit``, dropped ones included; ``across`` says what there is one for each
    of; ``labels`` has a name for each, or is empty where they are only numbered; ``leave_one_out``
    (n,) in mm where it was computed.
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
        """The values that count."""
        return np.delete(self.values, self.outliers)

    @property
    def rms(self) -> float:
        """Root mean square of the used ones."""
        return float(np.sqrt(np.mean(self.used**2)))

    @property
    def largest(self) -> float:
        """The largest of the used ones."""
        return float(self.used.max())


@dataclass(frozen=True, slots=True, eq=False)
class Finding:
    """One answer. ``transform`` is None where there is none to give: a lag, an ambiguous match.

    ``numbers``
        Name, with the unit at its end, to value.
    ``others``
        Transforms that were found with it.
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
        """``pivot: StylusTipToStylus``."""
        return self.kind if self.transform is None else f"{self.kind}: {name_of(self.transform)}"


def name_of(transform: Transform) -> str:
    """The name that SlicerIGT gives the transform."""
    return join_transform_name(transform.source, transform.target)


def as_json(finding: Finding, elapsed_s: float) -> dict[str, Any]:
    """The finding as JSON knows it; ``elapsed_s`` is the time to the answer."""
    residuals = finding.residuals
    return {
        "kind": finding.kind,
        "accepted": finding.accepted,
        "reason": finding.reason,
        "elapsed_s": round(elapsed_s, 3),
        "transform": None if finding.transform is None else _transform(finding.transform),
        "others": [_transform(other) for other in finding.others],
        "numbers": {name: _number(value) for name, value in finding.numbers.items()},
        "residuals": None if residuals is None else _residuals(residuals),
        "notes": list(finding.notes),
    }


def _transform(transform: Transform) -> dict[str, Any]:
    return {
        "name": name_of(transform),
        "target": transform.target,
        "source": transform.source,
        "matrix": transform.matrix.ravel().tolist(),
    }


def _residuals(residuals: Residuals) -> dict[str, Any]:
    left_out = residuals.leave_one_out
    return {
        "what": residuals.what,
        "unit": residuals.unit,
        "values": residuals.values.tolist(),
        "labels": list(residuals.labels),
        "outliers": list(residuals.outliers),
        "leave_one_out_mm": None if left_out is None else [_number(x) for x in left_out.tolist()],
    }


def _number(value: float) -> float | None:
    return value if np.isfinite(value) else None


def as_text(finding: Finding, elapsed_s: float) -> str:
    """The finding for a person, in aligned lines."""
    verdict = "accepted" if finding.accepted else "NOT ACCEPTED"
    lines = [f"{finding.title}  {verdict}", _line("reason", finding.reason)]
    for transform in (finding.transform, *finding.others):
        if transform is not None:
            lines += _matrix_lines(transform, "matrix" if transform is finding.transform else "")
    lines += [_line(*_named(name, value)) for name, value in finding.numbers.items()]
    if finding.residuals is not None and finding.residuals.labels:
        lines += _table(finding.residuals)
    lines += [_line("note", note) for note in finding.notes]
    lines.append(_line("time", f"{elapsed_s:.2f} s from the recording to the answer"))
    return "\n".join(lines)


def _line(label: str, text: str) -> str:
    return f"  {label:<18} {text}"


def _matrix_lines(transform: Transform, label: str) -> list[str]:
    rows = ["".join(f"{value:13.6f}" for value in row) for row in transform.matrix]
    return [
        _line((label or name_of(transform)) if n == 0 else "", row) for n, row in enumerate(rows)
    ]


def _named(name: str, value: float) -> tuple[str, str]:
    words, _, unit = name.rpartition("_")
    if unit not in UNITS:
        words, unit = name, ""
    text = f"{value:d}" if isinstance(value, int) else f"{value:.4g}"
    return words.replace("_", " "), f"{text} {unit}".rstrip()


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
