"""Links of a robot and their shapes."""

from dataclasses import dataclass
from typing import Self

import numpy as np

from app.geometry import FloatArray, SurfaceMesh
from app.robot.dynamics import LinkInertia

Rgba = tuple[float, float, float, float]


@dataclass(frozen=True, slots=True, eq=False)
class Shape:
    """One ``<visual>`` or ``<collision>``: a surface in its link's frame, in mm, origin applied.

    ``color`` (0 to 1) is that of the URDF's material, else that of the mesh file. A file of several
    colours gives ``face_colors`` (m, 4), one for each face of ``mesh``, and its most common one as
    ``color``. ``source`` is the file name in the URDF, or the kind of primitive (``box``).
    """

    mesh: SurfaceMesh
    color: Rgba | None
    source: str
    face_colors: FloatArray | None = None

    @classmethod
    def with_face_colors(
        cls, mesh: SurfaceMesh, face_colors: FloatArray | None, source: str
    ) -> Self:
        """Make a shape from ``mesh`` and the colours (m, 4) of its file, None where it has none."""
        if face_colors is None:
            return cls(mesh, None, source)
        distinct, counts = np.unique(face_colors, axis=0, return_counts=True)
        red, green, blue, alpha = distinct[np.argmax(counts)].tolist()
        several = face_colors if len(distinct) > 1 else None
        return cls(mesh, (red, green, blue, alpha), source, several)


@dataclass(frozen=True, slots=True, eq=False)
class Link:
    """A rigid body of the robot, with the shapes for display and those for collision.

    ``inertia`` is None where the file gives no mass.
    """

    name: str
    visuals: tuple[Shape, ...] = ()
    collisions: tuple[Shape, ...] = ()
    inertia: LinkInertia | None = None
