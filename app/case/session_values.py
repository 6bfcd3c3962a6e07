"""Values that a live session uses at present in the place of its ``live.yaml``, for a recording.

The session and its recorder are two processes: the values are a line of JSON and the bytes of the
surfaces, so that coordinates stay exact and nothing is encoded in the session's thread.
"""

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, BinaryIO

import numpy as np

from app.case.manifest.key_rules import MarginEntry
from app.geometry import FloatArray, FrameError, InputError, SurfaceMesh, Transform

_MAX_LINE = 262_144
_MAX_POINTS = 10_000_000


@dataclass(frozen=True, slots=True, eq=False)
class RegistrationValues:
    """A registration that an operator has accepted.

    ``covariance`` (6, 6) and ``degrees_of_freedom`` are those of `app.registration`.
    """

    reference_from_base: Transform
    covariance: FloatArray | None
    degrees_of_freedom: int | None


@dataclass(frozen=True, slots=True, eq=False)
class StructureValues:
    """A structure that is guarded beside the tumour, with the keys of a ``case.yaml``."""

    surface: SurfaceMesh
    frame_from_structure: Transform
    role: str
    stop_mm: float
    warn_mm: float
    sigma_mm: float


@dataclass(frozen=True, slots=True, eq=False)
class SessionValues:
    """Tips, tumour, structures, registration and margins in force.

    ``tumor`` and ``structures`` are None while they are those of ``live.yaml``, ``registration``
    while none was accepted in the session, ``image_depth_mm`` without several depths of the
    images. ``items``: the keys of ``case.yaml`` of each display item that an operator can change.
    """

    tool_from_tip: Transform
    tip_sigma_mm: float
    frame_from_tumor: Transform
    tumor_sigma_mm: float
    margins: MarginEntry
    tumor: SurfaceMesh | None
    registration: RegistrationValues | None
    items: Mapping[str, Mapping[str, Any]]
    image_depth_mm: float | None
    structures: tuple[StructureValues, ...] | None


def sent_values(values: SessionValues) -> Iterator[bytes]:
    """Yield the bytes from which `received_values` makes ``values``."""
    from app.files.plain_values import plain_converter  # slow to load

    surfaces: list[SurfaceMesh] = []

    def shape(surface: SurfaceMesh) -> list[str | int]:
        surfaces.append(surface)
        return [surface.frame, len(surface.vertices_mm), len(surface.faces)]

    converter = plain_converter()
    converter.register_unstructure_hook(SurfaceMesh, shape)
    yield json.dumps(converter.unstructure(values)).encode() + b"\n"
    for surface in surfaces:
        yield np.ascontiguousarray(surface.vertices_mm, dtype="<f8").tobytes()
        yield np.ascontiguousarray(surface.faces, dtype="<i4").tobytes()


def received_values(stream: BinaryIO) -> SessionValues:
    """Read from ``stream`` what `sent_values` has written.

    Raises `InputError` for anything else, also for a stream that ends before.
    """
    from app.files.plain_values import plain_converter  # slow to load

    converter = plain_converter()
    # Fields are read in the order in which they were written, and so are their surfaces.
    converter.register_structure_hook(SurfaceMesh, lambda shape, _: _surface(stream, *shape))
    try:
        return converter.structure(json.loads(stream.readline(_MAX_LINE)), SessionValues)
    except Exception as error:  # cattrs has many types for what does not fit
        raise InputError(
            f"values of the session: {type(error).__name__}: {str(error)[:200]}; expected those "
            "that a live session sends"
        ) from error


def check_frames(values: SessionValues, tool_from_tip: Transform, tumor: Transform) -> None:
    """Raise `FrameError` unless the frames are those of the two transforms of ``live.yaml``."""
    for found, expected in (
        (values.tool_from_tip, tool_from_tip),
        (values.frame_from_tumor, tumor),
    ):
        if (found.target, found.source) != (expected.target, expected.source):
            raise FrameError(
                f"live.yaml: places {expected.source!r} in {expected.target!r}; expected "
                f"{found.source!r} in {found.target!r} as in the session, which began before the "
                "file was changed"
            )


def _surface(stream: BinaryIO, frame: str, vertices: int, faces: int) -> SurfaceMesh:
    if not (0 < vertices <= _MAX_POINTS and 0 < faces <= _MAX_POINTS):
        raise ValueError(f"a surface of {vertices} vertices and {faces} faces")
    points = np.frombuffer(stream.read(vertices * 24), dtype="<f8").reshape(vertices, 3)
    corners = np.frombuffer(stream.read(faces * 12), dtype="<i4").reshape(faces, 3)
    return SurfaceMesh(frame, points, corners)
