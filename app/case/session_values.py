"""Values that a live session uses at present in the place of its ``live.yaml``, for a recording.

The session and its recorder are two processes: the values are a line of JSON and the bytes of the
surfaces, so that coordinates stay exact and nothing is encoded in the session's thread.
"""

import json
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, field
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
    tumor: SurfaceMesh | None = None
    registration: RegistrationValues | None = None
    items: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    image_depth_mm: float | None = None
    structures: tuple[StructureValues, ...] | None = None


def sent_values(values: SessionValues) -> Iterator[bytes]:
    """Yield the bytes from which `received_values` makes ``values``."""
    tumor, registered = values.tumor, values.registration
    structures = values.structures
    yield (
        json.dumps(
            {
                "tool_from_tip": _plain(values.tool_from_tip),
                "tip_sigma_mm": values.tip_sigma_mm,
                "frame_from_tumor": _plain(values.frame_from_tumor),
                "tumor_sigma_mm": values.tumor_sigma_mm,
                "margins": asdict(values.margins),
                "tumor": None if tumor is None else _shape(tumor),
                "registration": None if registered is None else _plain_registration(registered),
                "items": values.items,
                "image_depth_mm": values.image_depth_mm,
                "structures": None
                if structures is None
                else [
                    {
                        "surface": _shape(each.surface),
                        "pose": _plain(each.frame_from_structure),
                        "role": str(each.role),
                        "distances_mm": [each.stop_mm, each.warn_mm, each.sigma_mm],
                    }
                    for each in structures
                ],
            }
        ).encode()
        + b"\n"
    )
    surfaces = [each.surface for each in structures or ()]
    for surface in surfaces if tumor is None else (tumor, *surfaces):
        yield np.ascontiguousarray(surface.vertices_mm, dtype="<f8").tobytes()
        yield np.ascontiguousarray(surface.faces, dtype="<i4").tobytes()


def received_values(stream: BinaryIO) -> SessionValues:
    """Read from ``stream`` what `sent_values` has written.

    Raises `InputError` for anything else, also for a stream that ends before.
    """
    try:
        plain = json.loads(stream.readline(_MAX_LINE))
        registered, depth_mm = plain["registration"], plain["image_depth_mm"]
        return SessionValues(
            _transform(plain["tool_from_tip"]),
            float(plain["tip_sigma_mm"]),
            _transform(plain["frame_from_tumor"]),
            float(plain["tumor_sigma_mm"]),
            MarginEntry(**plain["margins"]),
            None if plain["tumor"] is None else _surface(stream, *plain["tumor"]),
            None if registered is None else _registration(registered),
            {name: dict(keys) for name, keys in plain["items"].items()},
            None if depth_mm is None else float(depth_mm),
            None
            if plain["structures"] is None
            else tuple(_structure(stream, each) for each in plain["structures"]),
        )
    except (AttributeError, KeyError, TypeError, ValueError) as error:
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


def _shape(surface: SurfaceMesh) -> list[str | int]:
    return [surface.frame, len(surface.vertices_mm), len(surface.faces)]


def _structure(stream: BinaryIO, plain: dict[str, Any]) -> StructureValues:
    return StructureValues(
        _surface(stream, *plain["surface"]),
        _transform(plain["pose"]),
        str(plain["role"]),
        *map(float, plain["distances_mm"]),
    )


def _plain(transform: Transform) -> dict[str, Any]:
    return {
        "target": transform.target,
        "source": transform.source,
        "matrix": transform.matrix.tolist(),
    }


def _transform(plain: dict[str, Any]) -> Transform:
    matrix = np.array(plain["matrix"], dtype=np.float64)
    if matrix.shape != (4, 4):
        raise ValueError(f"a matrix of shape {matrix.shape}")
    return Transform(plain["target"], plain["source"], matrix[:3, :3], matrix[:3, 3])


def _plain_registration(values: RegistrationValues) -> dict[str, Any]:
    return {
        "reference_from_base": _plain(values.reference_from_base),
        "covariance": None if values.covariance is None else values.covariance.tolist(),
        "degrees_of_freedom": values.degrees_of_freedom,
    }


def _registration(plain: dict[str, Any]) -> RegistrationValues:
    covariance = plain["covariance"]
    return RegistrationValues(
        _transform(plain["reference_from_base"]),
        None if covariance is None else np.array(covariance, dtype=np.float64),
        plain["degrees_of_freedom"],
    )


def _surface(stream: BinaryIO, frame: str, vertices: int, faces: int) -> SurfaceMesh:
    if not (0 < vertices <= _MAX_POINTS and 0 < faces <= _MAX_POINTS):
        raise ValueError(f"a surface of {vertices} vertices and {faces} faces")
    points = np.frombuffer(stream.read(vertices * 24), dtype="<f8").reshape(vertices, 3)
    corners = np.frombuffer(stream.read(faces * 12), dtype="<i4").reshape(faces, 3)
    return SurfaceMesh(frame, points, corners)
