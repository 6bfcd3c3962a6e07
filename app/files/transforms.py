"""A calibrated transform as a file: YAML for cases, ITK's text for 3D Slicer.

A ``.tfm`` file of Slicer does not hold the matrix that Slicer displays. ITK uses LPS axes where
Slicer uses RAS (x and y negated), and stores the transform from the parent, which resamples an
image. With ``F = diag(-1, -1, 1, 1)`` the file's matrix is ``F inverse(M) F`` for the ``M`` (to
parent, RAS) of Slicer's transforms module. The file rotates about a centre ``c``:
``y = A (x - c) + c + t`` (ITK, `MatrixOffsetTransformBase`). Slicer writes a centre; here it is 0.
"""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import yaml

from app.files.atomic_io import check_output_path, write_file
from app.files.bounded_io import read_bounded
from app.files.document import Section
from app.files.keys import Block, Numbers, Text
from app.files.numbers import parse_numbers
from app.geometry import (
    FloatArray,
    FrameError,
    InputError,
    MarginGuardError,
    Transform,
    join_transform_name,
)

RAS_LPS = np.diag([-1.0, -1.0, 1.0, 1.0])
"""RAS coordinates to LPS, and LPS to RAS."""

_DOCUMENT = Block(
    "a transform",
    {
        "transform": Text("its name", optional=True),
        "target": Text("its target frame", optional=True),
        "source": Text("its source frame", optional=True),
        "matrix": Numbers("16 numbers row by row, in mm", 16),
    },
)
_ITK_HEADER = "#Insight Transform File V1.0"
_ITK_LINEAR = ("AffineTransform_double_3_3", "MatrixOffsetTransformBase_double_3_3")
_MAX_BYTES = 1_000_000
_MAX_CENTRE_MM = 1e6
"""Largest coordinate of a centre of rotation; a larger one cancels digits of the translation."""


def write_transform(path: Path, transform: Transform, note: str = "") -> None:
    """Write ``transform`` atomically to ``path``, in the format of its ending.

    ``note`` is one line about its origin. An earlier file is replaced. Raises `InputError` for an
    ending that is not in `TRANSFORM_ENDINGS` and for a path that cannot be written.
    """
    check_transform_path(path)
    text = _WRITERS[path.suffix.lower()](transform, " ".join(note.split()))
    write_file(path, text.encode())


def check_transform_path(path: Path) -> None:
    """Raise `InputError` unless a transform can be written to ``path``; call before long work."""
    if path.suffix.lower() not in _WRITERS:
        raise InputError(f"{path} is not a transform file; expected {', '.join(TRANSFORM_ENDINGS)}")
    check_output_path(path)


def read_transform(path: Path, *, target: str, source: str) -> Transform:
    """Read ``target_from_source`` from a file of `write_transform`, of Slicer, or of 16 numbers.

    Frames are checked in YAML, the only format that has them. Raises `InputError` for a file that
    does not hold a rigid transform.
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
    document = Section.load(path, _DOCUMENT)
    for key, frame in (("target", target), ("source", source)):
        if key in document and document.text(key) != frame:
            raise FrameError(f"{key} is {document.text(key)!r}; expected {frame!r}")
    return Transform.from_matrix(document.numbers("matrix"), target=target, source=source)


def _to_itk(transform: Transform, note: str) -> str:
    stored = RAS_LPS @ transform.inverse().matrix @ RAS_LPS
    # + 0.0 turns negative zeros into zeros.
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
    """Read the matrix (4, 4), to parent and in RAS, of a text file."""
    text = read_bounded(path, _MAX_BYTES).decode("utf-8", errors="replace")
    if text.startswith(_ITK_HEADER):
        return _from_itk(text, path)
    numbers = parse_numbers(text, 16, f"{path} (a matrix, as it has no ITK header)")
    return np.array(numbers).reshape(4, 4)


def _from_itk(text: str, path: Path) -> FloatArray:
    lines = [line for line in text.splitlines() if line.strip() and not line.startswith("#")]
    fields = [(key.strip(), value) for key, _, value in (line.partition(":") for line in lines)]
    kinds = [value.strip() for key, value in fields if key == "Transform"]
    known = dict(fields)
    if len(kinds) != 1 or kinds[0] not in _ITK_LINEAR or len(known) != len(fields):
        raise InputError(
            f"{path} holds {', '.join(kinds) or 'nothing'} in {len(fields)} fields; expected one "
            f"{_ITK_LINEAR[0]} and no field twice"
        )
    parameters = np.array(parse_numbers(known.get("Parameters", ""), 12, f"{path}: Parameters"))
    centre = np.array(
        parse_numbers(known.get("FixedParameters", ""), 3, f"{path}: FixedParameters")
    )
    if not np.abs(centre).max() <= _MAX_CENTRE_MM:
        raise InputError(
            f"{path}: the centre, FixedParameters, is {centre.tolist()}; expected coordinates "
            f"of at most {_MAX_CENTRE_MM:g} mm"
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
"""Endings of YAML, and of ITK's text, which Slicer loads under both of its endings."""
