"""Check of an outline: a closed line of clicks in one image that must not cross itself."""

import numpy as np
import shapely

from app.contour.points import Contour, ContourPoint
from app.geometry import MeshError


def require_simple_outlines(contour: Contour) -> None:
    """Raise `MeshError` if the outline of an image crosses itself, with the points' numbers."""
    for image in contour.images:
        outline = contour.outline(image)
        crossing = _crossing(outline)
        if crossing is not None:
            (a, b), (c, d) = crossing
            raise MeshError(
                f"contour in image {image}: crosses itself between points {a} and {b} and points "
                f"{c} and {d}; expected a simple outline (drag or erase one of these points)"
            )


def _crossing(outline: tuple[ContourPoint, ...]) -> tuple[tuple[int, int], tuple[int, int]] | None:
    """The numbers of the ends of two edges that cross; None for a simple outline."""
    count = len(outline)
    if count < 4:
        return None
    corners = np.array([point.pixel for point in outline])
    edges = shapely.linestrings(np.stack([corners, np.roll(corners, -1, axis=0)], axis=1))
    first, second = shapely.STRtree(edges).query(edges, predicate="intersects")
    apart = (second - first) % count
    # Neighbours share a point.
    for k in np.flatnonzero((first < second) & (apart > 1) & (apart < count - 1)):
        ends = [
            (outline[n].number, outline[(n + 1) % count].number)
            for n in (int(first[k]), int(second[k]))
        ]
        return ends[0], ends[1]
    return None
