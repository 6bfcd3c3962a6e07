"""Output of a calibration or registration: printed text or JSON, saved file, plot, exit status."""

import json
import sys
from pathlib import Path

import yaml

from app.cli.calibration.calibration_result import CalibrationResult, as_json, as_text
from app.files import check_output_path, check_transform_path, write_file, write_transform
from app.geometry import InputError

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
    from app.report.residual_plot import residual_png

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
