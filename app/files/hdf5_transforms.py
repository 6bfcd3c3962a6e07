"""Linear transforms in HDF5 files of ITK (``.h5``), Slicer's default for transforms.

libhdf5 allocates what a file declares and has had faults on damaged files, so h5py reads in a
process of its own with limits (`app.files.hdf5_child`), one for all files of a sequence.
"""

import json
import signal
import struct
from collections.abc import Sequence
from functools import partial
from typing import Any

from app.files.child_process import Ask, ChildError, ask
from app.files.extras import check_installed
from app.files.itk_parameters import ITK_LINEAR, matrix_from_parameters
from app.geometry import FloatArray, InputError, MarginGuardError

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
    try:
        return matrix_from_parameters(parameters, centre, place)
    except InputError:
        raise
    except MarginGuardError as error:
        raise InputError(f"{place}: {error}") from error
