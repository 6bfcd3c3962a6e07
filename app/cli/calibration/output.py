"""Prints, saves and draws a finding, and says by an exit status whether it may be used."""

import json
import sys
from pathlib import Path

import yaml

from app.cli.calibration.calibration_result import Finding, as_json, as_text
from app.files import check_place, check_transform_path, write_small, write_transform
from app.geometry import InputError

NOT_ACCEPTED = 1
_YAML = (".yaml", ".yml")


def check_outputs(save: Path | None, plot: Path | None, *, clock: bool = False) -> None:
    """Raise `InputError` for places that cannot be written, before the work is done.

    ``clock``: an offset will be saved and no transform.
    """
    if save is not None and clock:
        if save.suffix.lower() not in _YAML:
            raise InputError(f"{save}: an offset is saved as {' or '.join(_YAML)}")
        check_place(save)
    elif save is not None:
        check_transform_path(save)
    if plot is not None:
        if plot.suffix.lower() != ".png":
            raise InputError(f"{plot}: a plot is written as .png")
        check_place(plot)


def put_out(
    finding: Finding, elapsed_s: float, *, as_json_text: bool, save: Path | None, plot: Path | None
) -> int:
    """Print; draw what there is to draw; save what is accepted. Returns the exit status."""
    if as_json_text:
        print(json.dumps(as_json(finding, elapsed_s), indent=2, allow_nan=False))
    else:
        print(as_text(finding, elapsed_s))
    if plot is not None:
        _draw(finding, plot)
    if not finding.accepted:
        if save is not None:
            print(f"{save} is not written: not accepted", file=sys.stderr)
        return NOT_ACCEPTED
    if save is not None:
        _save(finding, save)
    return 0


def _save(finding: Finding, path: Path) -> None:
    note = f"{finding.kind}: {finding.reason}"
    if finding.transform is not None:
        write_transform(path, finding.transform, note)
        return
    # As it stands in a case.yaml.
    key = "offset_robot_to_tracker_ms"
    text = yaml.safe_dump({"clock": {key: finding.numbers[key]}})
    write_small(path, f"# {note}\n{text}".encode())


def _draw(finding: Finding, path: Path) -> None:
    residuals = finding.residuals
    if residuals is None or not len(residuals.values):
        print(f"{path} is not written: there are no residuals", file=sys.stderr)
        return
    from app.report.residual_plot import residual_png

    verdict = "accepted" if finding.accepted else "not accepted"
    picture = residual_png(
        residuals.values,
        title=f"{finding.title} ({verdict})",
        what=residuals.what,
        unit=residuals.unit,
        across=residuals.across,
        labels=residuals.labels,
        outliers=residuals.outliers,
    )
    write_small(path, picture)
