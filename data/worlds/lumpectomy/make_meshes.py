"""Draws the chest wall: ``python make_meshes.py [FOLDER]`` writes binary STL, in mm.

A plate bent about the x axis, as ribs below a breast. Same numbers, same bytes.
"""

import sys
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

LENGTH_MM, RADIUS_MM, THICKNESS_MM = 200.0, 110.0, 12.0
HALF_ANGLE_RAD = 0.8
COUNT = 13


def chest_wall() -> NDArray[np.float64]:
    """Triangles (m, 3, 3) of the closed plate; the top of its bend is the origin."""
    x = np.linspace(-LENGTH_MM / 2.0, LENGTH_MM / 2.0, COUNT)
    angle = np.linspace(-HALF_ANGLE_RAD, HALF_ANGLE_RAD, COUNT)

    def sheet(radius: float) -> NDArray[np.float64]:
        points = np.zeros((COUNT, COUNT, 3))
        points[..., 0] = x[:, None]
        points[..., 1] = radius * np.sin(angle)
        points[..., 2] = radius * np.cos(angle) - RADIUS_MM
        return points

    top, bottom = sheet(RADIUS_MM), sheet(RADIUS_MM - THICKNESS_MM)
    triangles = [*_quads(top), *_quads(bottom[:, ::-1])]
    for edge_top, edge_bottom in (
        (top[0], bottom[0]),
        (top[-1, ::-1], bottom[-1, ::-1]),
        (top[::-1, 0], bottom[::-1, 0]),
        (top[:, -1], bottom[:, -1]),
    ):
        triangles += _quads(np.stack([edge_bottom, edge_top]))
    return np.concatenate(triangles)


def _quads(grid: NDArray[np.float64]) -> list[NDArray[np.float64]]:
    a, b, c, d = grid[:-1, :-1], grid[1:, :-1], grid[1:, 1:], grid[:-1, 1:]
    return [np.stack(corners, axis=2).reshape(-1, 3, 3) for corners in ((a, b, c), (a, c, d))]


def binary_stl(triangles: NDArray[np.float64]) -> bytes:
    """The file of triangles (m, 3, 3) with their normals; mm, rounded to a nanometre."""
    corners = np.round(triangles, 6) + 0.0  # no -0.0, which is another byte
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    records = np.zeros(len(corners), dtype=[("floats", "<f4", 12), ("attribute", "<u2")])
    records["floats"][:, :3] = np.round(normals, 6) + 0.0
    records["floats"][:, 3:] = corners.reshape(-1, 9)
    header = b"MarginGuard chest wall, binary STL, mm".ljust(80)
    return header + np.uint32(len(records)).astype("<u4").tobytes() + records.tobytes()


if __name__ == "__main__":
    folder = Path(sys.argv[1]) if sys.argv[1:] else Path(__file__).parent
    (folder / "chest_wall.stl").write_bytes(binary_stl(chest_wall()))
