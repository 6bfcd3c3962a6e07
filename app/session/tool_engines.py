"""Distance engines for many cases with one tool, which is prepared once."""

import numpy as np

from app.fixture import ProximityEngine
from app.fixture.proximity.engine import prepared_tumor
from app.geometry import SurfaceMesh


class ToolEngines:
    """Makes the `ProximityEngine` of each case in turn, by one thread.

    The tool of the last case is not prepared again where the next one has the same surface. The
    engines give the same results as new ones.
    """

    def __init__(self) -> None:
        self._last: tuple[SurfaceMesh, ProximityEngine] | None = None

    def __call__(self, tumor: SurfaceMesh, tool: SurfaceMesh) -> ProximityEngine:
        """The engine for ``tumor`` and ``tool``; raises `MeshError` as its constructor."""
        if self._last is not None and _same(self._last[0], tool):
            engine = self._last[1].with_tumor(prepared_tumor(tumor))
        else:
            engine = ProximityEngine(tumor, tool)
        self._last = tool, engine
        return engine


def _same(one: SurfaceMesh, other: SurfaceMesh) -> bool:
    return (
        one.frame == other.frame
        and np.array_equal(one.vertices_mm, other.vertices_mm)
        and np.array_equal(one.faces, other.faces)
    )
