"""What a link looks like and what it can touch."""

from dataclasses import dataclass

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


@dataclass(frozen=True, slots=True, eq=False)
class Link:
    """A rigid body of the robot: everything that is drawn of it, everything that collides."""

    name: str
    visuals: tuple[Shape, ...] = ()
    collisions: tuple[Shape, ...] = ()
