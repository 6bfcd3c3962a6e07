"""What a link looks like and what it can touch."""

from dataclasses import dataclass
from typing import Self

import numpy as np

from app.geometry import FloatArray, SurfaceMesh

Rgba = tuple[float, float, float, float]


@dataclass(frozen=True, slots=True, eq=False)
class Shape:
    """One ``<visual>`` or ``<collision>``: a surface in its link's frame, in mm, origin applied.

    ``color`` (0 to 1) is the URDF's material, else the colour of the file where it has a single
    one. A file of several colours gives ``face_colors`` (m, 4), one a face of ``mesh``, and its
    most common one as ``color``. ``source`` is the name in the URDF, or ``box`` and the like.
    """

    mesh: SurfaceMesh
    color: Rgba | None
    source: str
    face_colors: FloatArray | None = None

    @classmethod
    def of(cls, mesh: SurfaceMesh, face_colors: FloatArray | None, source: str) -> Self:
        """``mesh`` in the colours of its file: (m, 4), or None where it has none."""
        if face_colors is None:
            return cls(mesh, None, source)
        distinct, counts = np.unique(face_colors, axis=0, return_counts=True)
        red, green, blue, alpha = distinct[np.argmax(counts)].tolist()
        several = face_colors if len(distinct) > 1 else None
        return cls(mesh, (red, green, blue, alpha), source, several)


@dataclass(frozen=True, slots=True, eq=False)
class Link:
    """A rigid body of the robot: everything that is drawn of it, everything that collides."""

    name: str
    visuals: tuple[Shape, ...] = ()
    collisions: tuple[Shape, ...] = ()
