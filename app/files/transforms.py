"""A calibrated transform as a file: YAML for people and cases, ITK's text for 3D Slicer.

Slicer's ``.tfm`` holds something else than it shows. ITK counts LPS where Slicer counts RAS (x and
y the other way round), and stores the transform that resamples an image, which takes points from
the parent. With ``F = diag(-1, -1, 1, 1)`` the matrix of the file is ``F inverse(M) F`` for the
``M`` (to parent, RAS) that the transforms module shows. The file turns about a centre ``c``:
``y = A (x - c) + c + t``; Slicer writes one, here it is 0.
"""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import yaml

from app.files.atomic_io import check_output_path, write_file
from app.files.bounded_io import read_bounded
from app.files.document import Section
from app.files.numbers import numbers_in
from app.geometry import (
    FloatArray,
    FrameError,
    InputError,
    MarginGuardError,
    Transform,
    join_transform_name,
)

RAS_LPS = np.diag([-1.0, -1.0, 1.0, 1.0])
"""RAS coordinates to LPS, and the same back."""

_ITK_HEADER = "#Insight Transform File V1.0"
_ITK_LINEAR = ("AffineTransform_double_3_3", "MatrixOffsetTransformBase_double_3_3")
_MAX_BYTES = 1_000_000
_FARTHEST_MM = 1e6
"""Of a centre of turning; from far away it would take the digits of the shift."""


def write_transform(path: Path, transform: Transform, note: str = "") -> None:
    """Write ``transform`` to ``path``, all or nothing, by its ending: `TRANSFORM_ENDINGS`.

    ``note`` is one line on where it comes from. An earlier file is replaced. Raises `InputError`
    for another ending and for a place that cannot be written.
    """
    check_transform_path(path)
    text = _WRITERS[path.suffix.lower()](transform, " ".join(note.split()))
    write_file(path, text.encode())


def check_transform_path(path: Path) -> None:
    """Raise `InputError` unless a transform can go to ``path``: ask before the work is done."""
    if path.suffix.lower() not in _WRITERS:
        raise InputError(f"{path} is no transform file: {', '.join(TRANSFORM_ENDINGS)} allowed")
    check_output_path(path)


def read_transform(path: Path, *, target: str, source: str) -> Transform:
    """``target_from_source`` from a file of `write_transform`, of Slicer, or of 16 plain numbers.

    Only YAML knows its frames, and there they are checked. Raises `InputError` for anything that
    is no rigid transform.
    """
    try:
        if path.suffix.lower() in _YAML:
            return _from_yaml(path, target, source)
        return Transform.from_matrix(_matrix_of(path), target=target, source=source)
    except InputError:
        raise
    except MarginGuardError as error:
        raise InputError(f"{path}: {error}") from error


def _to_yaml(transform: Transform, note: str) -> str:
    document = {
        "transform": join_transform_name(transform.source, transform.target),
        "target": transform.target,
        "source": transform.source,
        "matrix": transform.matrix.ravel().tolist(),
    }
    comment = f"# {note}\n" if note else ""
    return comment + yaml.safe_dump(document, sort_keys=False, width=100)


def _from_yaml(path: Path, target: str, source: str) -> Transform:
    document = Section.load(path, ("transform", "target", "source", "matrix"))
    for key, wanted in (("target", target), ("source", source)):
        if key in document and document.text(key) != wanted:
            raise FrameError(f"{key} is {document.text(key)!r}: {wanted!r} wanted")
    return Transform.from_matrix(document.numbers("matrix", 16), target=target, source=source)


def _to_itk(transform: Transform, note: str) -> str:
    stored = RAS_LPS @ transform.inverse().matrix @ RAS_LPS
    # + 0.0: no negative zeros.
    numbers = np.concatenate([stored[:3, :3].ravel(), stored[:3, 3]]) + 0.0
    name = join_transform_name(transform.source, transform.target)
    return "\n".join(
        [
            _ITK_HEADER,
            f"# {name}{': ' if note else ''}{note}",
            "#Transform 0",
            f"Transform: {_ITK_LINEAR[0]}",
            f"Parameters: {' '.join(f'{number:.17g}' for number in numbers)}",
            "FixedParameters: 0 0 0",
            "",
        ]
    )


def _matrix_of(path: Path) -> FloatArray:
    """The matrix (4, 4), to parent and in RAS, of a text file."""
    text = read_bounded(path, _MAX_BYTES).decode("utf-8", errors="replace")
    if text.startswith(_ITK_HEADER):
        return _from_itk(text, path)
    numbers = numbers_in(text, 16, f"{path} (no ITK transform, so a matrix)")
    return np.array(numbers).reshape(4, 4)


def _from_itk(text: str, path: Path) -> FloatArray:
    lines = [line for line in text.splitlines() if line.strip() and not line.startswith("#")]
    fields = [(key.strip(), value) for key, _, value in (line.partition(":") for line in lines)]
    kinds = [value.strip() for key, value in fields if key == "Transform"]
    known = dict(fields)
    if len(kinds) != 1 or kinds[0] not in _ITK_LINEAR or len(known) != len(fields):
        raise InputError(
            f"{path} holds {', '.join(kinds) or 'nothing'} in {len(fields)} fields: one "
            f"{_ITK_LINEAR[0]} wanted, and no field twice"
        )
    parameters = np.array(numbers_in(known.get("Parameters", ""), 12, f"{path}: Parameters"))
    centre = np.array(numbers_in(known.get("FixedParameters", ""), 3, f"{path}: FixedParameters"))
    if not np.abs(centre).max() <= _FARTHEST_MM:
        raise InputError(
            f"{path}: FixedParameters, a centre, are {centre.tolist()}: {_FARTHEST_MM:g} mm allowed"
        )
    stored = Transform("lps", "lps", parameters[:9].reshape(3, 3), parameters[9:])
    turned = stored.rotation @ centre
    about_origin = Transform("lps", "lps", stored.rotation, parameters[9:] + centre - turned)
    return np.asarray(RAS_LPS @ about_origin.inverse().matrix @ RAS_LPS)


_YAML = (".yaml", ".yml")
_WRITERS: dict[str, Callable[[Transform, str], str]] = {
    **dict.fromkeys(_YAML, _to_yaml),
    ".tfm": _to_itk,
    ".txt": _to_itk,
}
TRANSFORM_ENDINGS = tuple(_WRITERS)
"""YAML, and ITK's text, which Slicer loads under either ending."""
