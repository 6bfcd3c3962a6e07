"""Files that a mesh file names: regular files in its folder or below, up to a bound."""

from pathlib import Path
from typing import Any

from trimesh.resolvers import Resolver

from app.files.bounded_io import read_bounded
from app.files.paths import resolve_inside
from app.geometry import InputError

_MAX_MATERIAL_BYTES = 4_000_000


def read_linked(mesh: Path, name: str, max_bytes: int) -> bytes:
    """Read the file ``name`` beside ``mesh``.

    Raises `InputError` for one that is missing, outside the folder or larger than ``max_bytes``.
    """
    path = resolve_inside(mesh.parent, name, f"{mesh}: a linked file")
    return read_bounded(path, max_bytes)


class MaterialFiles(Resolver):
    """Gives trimesh the material files of an OBJ and nothing else.

    A picture would be opened for its size only. A file that is missing or cannot be read is an
    `OSError`, and the mesh is read without colours.
    """

    def __init__(self, mesh: Path) -> None:
        self.file_name = mesh.name
        self._mesh = mesh

    def get(self, key: str) -> bytes:
        """Return the content of a file that ends with ``.mtl``."""
        if not key.lower().endswith(".mtl"):
            raise OSError(f"{key[:60]!r} is not a material file")
        try:
            return read_linked(self._mesh, key, _MAX_MATERIAL_BYTES)
        except InputError as error:
            raise OSError(str(error)) from error

    def keys(self) -> tuple[str, ...]:
        """Return no names: the folder is not searched."""
        return ()

    def namespaced(self, namespace: str) -> "MaterialFiles":
        """Return a resolver for the same folder."""
        return self

    def write(self, name: str, data: Any) -> None:
        """Refuse to write."""
        raise OSError(f"{name[:60]!r} is not written")
