"""Options of a caller for reading mesh files."""

from dataclasses import dataclass

from app.geometry import MarginGuardError, MeshError


@dataclass(frozen=True, slots=True)
class MeshOptions:
    """Options of a caller for reading mesh files: accepted formats, limits, axes.

    ``formats``
        Accepted endings, in lower case, with the dot.
    ``max_triangles``
        Limit over all parts at all places: a file may place one part many times.
    ``linked_files``
        Whether materials and buffers in files beside the mesh are read.
    ``slicer_axes``
        Whether a comment ``SPACE=LPS``, which 3D Slicer writes, turns x and y around.
    ``error``
        Type of the error that is raised.
    """

    formats: tuple[str, ...]
    max_bytes: int
    max_triangles: int
    linked_files: bool = False
    slicer_axes: bool = False
    error: type[MarginGuardError] = MeshError
