"""A calibrated transform as a file: YAML for cases, ITK's text (``.tfm``) or HDF5 (``.h5``).

ITK does not store the matrix that Slicer displays. It uses LPS axes where Slicer uses RAS (x and y
negated), and stores the transform from the parent, which resamples an image. With
``F = diag(-1, -1, 1, 1)`` the file's matrix is ``F inverse(M) F`` for the ``M`` (to parent, RAS) of
Slicer's transforms module. The file rotates about a centre ``c``: ``y = A (x - c) + c + t`` (ITK,
`MatrixOffsetTransformBase`). Slicer writes a centre; here it is 0.

libhdf5 allocates what a file declares and has had faults on damaged files, so h5py reads in a
process of its own with limits (`app.files.hdf5_child`), one for all files of a sequence. ITK's text
is not read by SimpleITK, which is an optional dependency.
"""

import json
import signal
import struct
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from app.files.atomic_io import check_output_path, write_file
from app.files.bounded_io import read_bounded
from app.files.child_process import Ask, ChildError, ask
from app.files.document import Section
from app.files.extras import check_installed
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

ITK_LINEAR = ("AffineTransform_double_3_3", "MatrixOffsetTransformBase_double_3_3")
"""Types of transforms with the 12 parameters of a matrix; the first is the one written."""

_MAX_CENTRE_MM = 1e6
"""Largest coordinate of a centre of rotation; a larger one cancels digits of the translation."""


def matrix_from_parameters(
    parameters: Sequence[float], centre_mm: Sequence[float], place: str
) -> FloatArray:
    """The matrix (4, 4), to parent and in RAS, of a linear transform of ITK.

    ``parameters`` are 12 numbers, ``centre_mm`` 3, the fixed parameters. Raises `InputError`, with
    ``place``, for a centre that is too far away, and a `MarginGuardError` for a matrix that is not
    rigid.
    """
    values, centre = np.array(parameters), np.array(centre_mm)
    if not np.abs(centre).max() <= _MAX_CENTRE_MM:
        raise InputError(
            f"{place}: the centre, FixedParameters, is {centre.tolist()}; expected coordinates "
            f"of at most {_MAX_CENTRE_MM:g} mm"
        )
    stored = Transform("lps", "lps", values[:9].reshape(3, 3), values[9:])
    turned = stored.rotation @ centre
    about_origin = Transform("lps", "lps", stored.rotation, values[9:] + centre - turned)
    return np.asarray(RAS_LPS @ about_origin.inverse().matrix @ RAS_LPS)


HDF5_SIGNATURE = b"\x89HDF\r\n\x1a\n"
"""The first bytes of an HDF5 file of ITK."""

MAX_FILES = 100_000
MAX_CPU_S = 1.5
CPU_S_PER_FILE = 0.002
"""Limits of the processor time; a file takes about 0.3 ms."""
MAX_WALL_S = 60.0

_ASK = partial(
    ask,
    "app.files.hdf5_child",
    max_s=MAX_WALL_S,
    HDF5_PLUGIN_PRELOAD="::",  # loads no filter from a folder of the system
)


def read_hdf5_matrices(
    contents: Sequence[bytes], places: Sequence[str], *, ask: Ask = _ASK
) -> list[FloatArray]:
    """The matrices (4, 4), to parent and in RAS, of files of which each has one linear transform.

    ``places`` name the files in messages. Raises `InputError` for a file that cannot be read or
    holds anything else, and without h5py.
    """
    check_installed("h5py")
    if len(contents) > MAX_FILES:
        raise InputError(
            f"{places[0]}: there are {len(contents)} HDF5 files; expected {MAX_FILES} or fewer"
        )
    limit = struct.pack(">d", MAX_CPU_S + CPU_S_PER_FILE * len(contents))
    request = b"".join(
        [limit, *(struct.pack(">Q", len(content)) + content for content in contents)]
    )
    try:
        status, reply = ask(request)
    except ChildError as problem:
        raise InputError(f"{places[0]} cannot be read: the HDF5 library {problem}") from problem
    # The reply has one line per file; where the process has ended, that file is the cause.
    lines = reply.splitlines()
    matrices = [_matrix(line, place) for line, place in zip(lines, places, strict=False)]
    if len(lines) < len(places):
        cause = (
            "it takes too long"
            if status == -signal.SIGPROF
            else f"the HDF5 library ended with status {status}"
        )
        raise InputError(f"{places[len(lines)]} cannot be read: {cause}")
    return matrices


def _matrix(line: bytes, place: str) -> FloatArray:
    found: dict[str, Any] = json.loads(line)
    if "error" in found:
        raise InputError(f"{place} is not a transform of ITK: {found['error']}")
    kinds: list[str] = found["kinds"]
    if len(kinds) != 1 or kinds[0] not in ITK_LINEAR:
        raise InputError(
            f"{place} holds {', '.join(kinds) or 'nothing'}; expected one {ITK_LINEAR[0]}"
        )
    parameters, centre = found["parameters"], found["fixed"]
    if len(parameters) != 12 or len(centre) != 3:
        raise InputError(
            f"{place} has {len(parameters)} parameters and {len(centre)} fixed ones; "
            "expected 12 and 3"
        )
    with _named(place):
        return matrix_from_parameters(parameters, centre, place)


@contextmanager
def _named(place: object) -> Iterator[None]:
    """Name ``place`` in the `InputError` that each fault of a matrix or a frame raises."""
    try:
        yield
    except InputError:
        raise
    except MarginGuardError as error:
        raise InputError(f"{place}: {error}") from error


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
    with _named(path):
        return Transform.from_matrix(
            read_affine(path, target=target, source=source), target=target, source=source
        )


def read_any_transform(path: Path) -> tuple[FloatArray, tuple[str, str] | None]:
    """Read the matrix (4, 4) of a file as `read_transform`, and target and source if it has both.

    Raises `InputError` for a file that does not hold a rigid transform.
    """
    if path.suffix.lower() not in _YAML:
        return read_transform(path, target="target", source="source").matrix, None
    document = Section.load(path, _DOCUMENT)
    target, source = (document.text(key) if key in document else "" for key in ("target", "source"))
    names = (target, source) if target and source else None
    pose = read_transform(path, target=target or "target", source=source or "source")
    return pose.matrix, names


def read_affine(path: Path, *, target: str, source: str) -> FloatArray:
    """Read the matrix (4, 4) of ``target_from_source``, which may be scaled, as `read_transform`.

    Raises `InputError` for another kind of file.
    """
    with _named(path):
        if path.suffix.lower() not in _YAML:
            return _matrix_of(path)
        document = Section.load(path, _DOCUMENT)
        _check_frames(document, target, source)
        return np.array(document.numbers("matrix")).reshape(4, 4)


def _to_yaml(transform: Transform, note: str) -> str:
    document = {
        "transform": join_transform_name(transform.source, transform.target),
        "target": transform.target,
        "source": transform.source,
        "matrix": transform.matrix.ravel().tolist(),
    }
    comment = f"# {note}\n" if note else ""
    return comment + yaml.safe_dump(document, sort_keys=False, width=100)


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
