"""The needle of a session: where its tip is and what is drawn of it. No decision depends on it."""

from dataclasses import dataclass, replace

import numpy as np

from app.case import MAX_NEEDLE_MM, MIN_NEEDLE_MM, Case
from app.geometry import FloatArray, InputError, SurfaceMesh, Transform
from app.runtime.pointed_rod import pointed_rod

NEEDLE_RADIUS_MM = 0.75
"""Radius of a needle that is drawn without a model of its own."""

_POINT_MM = 4.0


@dataclass(frozen=True, slots=True, eq=False)
class Needle:
    """A needle of ``length_mm`` from its sensor to its tip.

    ``frame_from_tip``: the tip in the tracked frame of the sensor, +z forward. ``surface`` is in
    the frame of the tip; ``is_generated``: it follows the length.
    """

    length_mm: float
    frame_from_tip: Transform
    surface: SurfaceMesh
    is_generated: bool

    def with_length(self, length_mm: float) -> "Needle":
        """The same needle with another length. Raises `InputError` for one out of range."""
        if not MIN_NEEDLE_MM <= length_mm <= MAX_NEEDLE_MM:
            raise InputError(
                f"needle: a length of {length_mm:.6g} mm; expected {MIN_NEEDLE_MM:g} to "
                f"{MAX_NEEDLE_MM:g} mm"
            )
        known = self.frame_from_tip
        forward = known.rotation[:, 2]
        return replace(
            self,
            length_mm=length_mm,
            frame_from_tip=Transform(
                known.target, known.source, known.rotation, length_mm * forward
            ),
            surface=thin_needle(length_mm, known.source) if self.is_generated else self.surface,
        )


def needle_of(case: Case) -> Needle | None:
    """The needle of ``case``; None without one. Raises `MarginGuardError` for a broken model."""
    entry = case.manifest.needle
    if entry is None:
        return None
    rotation, model = _turned_from_z(np.array(entry.direction)), case.needle_mesh()
    return Needle(
        entry.length_mm,
        Transform(entry.frame, entry.tip_frame, rotation, entry.length_mm * rotation[:, 2]),
        thin_needle(entry.length_mm, entry.tip_frame) if model is None else model,
        is_generated=model is None,
    )


def thin_needle(length_mm: float, frame: str) -> SurfaceMesh:
    """A closed needle along z in ``frame``, its tip at 0 and its other end at ``-length_mm``."""
    return pointed_rod(length_mm, NEEDLE_RADIUS_MM, _POINT_MM, frame)


def _turned_from_z(direction: FloatArray) -> FloatArray:
    """A rotation (3, 3) of z to the unit vector ``direction`` (3,); the smallest one for z >= 0."""
    x, y, z = direction
    if z < 0.0:
        half_turn = np.diag([1.0, -1.0, -1.0])
        return np.asarray(half_turn @ _turned_from_z(half_turn @ direction))
    cross = np.array([[0.0, 0.0, x], [0.0, 0.0, y], [-x, -y, 0.0]])
    rotation: FloatArray = np.eye(3) + cross + cross @ cross / (1.0 + z)
    return rotation
