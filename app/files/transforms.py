"""A calibrated transform as a file: YAML for cases, ITK's text or HDF5 of 3D Slicer.

`app.files.itk_parameters` describes how ITK stores the matrix that Slicer displays. ITK's text is
not read by SimpleITK, which is an optional dependency.
"""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import yaml

from app.files.atomic_io import check_output_path, write_file
from app.files.bounded_io import read_bounded
from app.files.document import Section
from app.files.hdf5_transforms import HDF5_SIGNATURE, read_hdf5_matrices
from app.files.itk_parameters import ITK_LINEAR, RAS_LPS, matrix_from_parameters
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
_MAX_BYTES = 1_000_000


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

    Slicer's ``.h5`` is recognised by its content and needs h5py. Frames are checked in YAML, the
    only format that has them. Raises `InputError` for a file that does not hold a rigid transform.
    """
    try:
        if path.suffix.lower() in _YAML:
            return _from_yaml(path, target, source)
        return Transform.from_matrix(_matrix_of(path), target=target, source=source)
    except InputError:
        raise
    except MarginGuardError as error:
        raise InputError(f"{path}: {error}") from error


def read_any_transform(path: Path) -> tuple[FloatArray, tuple[str, str] | None]:
    """Read the matrix (4, 4) of a file as `read_transform`, and target and source if it has both.

    Raises `InputError` for a file that does not hold a rigid transform.
    """
    if path.suffix.lower() not in _YAML:
        return read_transform(path, target="target", source="source").matrix, None
    document = Section.load(path, _DOCUMENT)
    target, source = (
        document.text(key) if key in document else fallback
        for key, fallback in (("target", ""), ("source", ""))
    )
    names = (target, source) if target and source else None
    pose = read_transform(path, target=target or "target", source=source or "source")
    return pose.matrix, names


def read_affine(path: Path, *, target: str, source: str) -> FloatArray:
    """Read the matrix (4, 4) of ``target_from_source``, which may be scaled, as `read_transform`.

    Raises `InputError` for another kind of file.
    """
    try:
        if path.suffix.lower() not in _YAML:
            return _matrix_of(path)
        document = Section.load(path, _DOCUMENT)
        _check_frames(document, target, source)
        return np.array(document.numbers("matrix")).reshape(4, 4)
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
    _check_frames(document, target, source)
    return Transform.from_matrix(document.numbers("matrix"), target=target, source=source)


def _check_frames(document: Section, target: str, source: str) -> None:
    for key, frame in (("target", target), ("source", source)):
        if key in document and document.text(key) != frame:
            raise FrameError(f"{key} is {document.text(key)!r}; expected {frame!r}")


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
            f"Transform: {ITK_LINEAR[0]}",
            f"Parameters: {' '.join(f'{number:.17g}' for number in numbers)}",
            "FixedParameters: 0 0 0",
            "",
        ]
    )


def _matrix_of(path: Path) -> FloatArray:
    """Read the matrix (4, 4), to parent and in RAS, of a text file or an ``.h5`` file."""
    content = read_bounded(path, _MAX_BYTES)
    if content.startswith(HDF5_SIGNATURE):
        return read_hdf5_matrices([content], [str(path)])[0]
    text = content.decode("utf-8", errors="replace")
    if text.startswith(_ITK_HEADER):
        return _from_itk(text, path)
    numbers = parse_numbers(text, 16, f"{path} (a matrix, as it has no ITK header)")
    return np.array(numbers).reshape(4, 4)


def _from_itk(text: str, path: Path) -> FloatArray:
    lines = [line for line in text.splitlines() if line.strip() and not line.startswith("#")]
    fields = [(key.strip(), value) for key, _, value in (line.partition(":") for line in lines)]
    kinds = [value.strip() for key, value in fields if key == "Transform"]
    known = dict(fields)
    if len(kinds) != 1 or kinds[0] not in ITK_LINEAR or len(known) != len(fields):
        raise InputError(
            f"{path} holds {', '.join(kinds) or 'nothing'} in {len(fields)} fields; expected one "
            f"{ITK_LINEAR[0]} and no field twice"
        )
    return matrix_from_parameters(
        parse_numbers(known.get("Parameters", ""), 12, f"{path}: Parameters"),
        parse_numbers(known.get("FixedParameters", ""), 3, f"{path}: FixedParameters"),
        str(path),
    )


_YAML = (".yaml", ".yml")
_WRITERS: dict[str, Callable[[Transform, str], str]] = {
    **dict.fromkeys(_YAML, _to_yaml),
    ".tfm": _to_itk,
    ".txt": _to_itk,
}
TRANSFORM_ENDINGS = tuple(_WRITERS)
"""Endings of YAML, and of ITK's text, which Slicer loads under both of its endings."""
