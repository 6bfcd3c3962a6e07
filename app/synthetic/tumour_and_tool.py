"""Surfaces and frames of a simulated case: an irregular tumour, a monopolar tool, STL files."""

from dataclasses import dataclass, replace
from functools import cache
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from app.geometry import FloatArray, SurfaceMesh

TUMOR_FRAME = "tumor"
BASE_FRAME = "robot_base"
TUMOR_SENSOR = "needle"
"""The tracked frame that the tumour moves with."""
TOOL_SENSOR = "cautery"
"""The tracked frame of the tool."""
TIP_FRAME, TOOL_FILE = f"{TOOL_SENSOR}_tip", f"{TOOL_SENSOR}.stl"
TOOL_LINK = "stylus"
"""The last link of a Touch, whose origin is the tool's tip."""


IndexArray = NDArray[np.int64]


SEMI_AXES_MM = (15.0, 12.5, 11.0)
LOBE_COUNT = 14
LOBE_HEIGHT = (-0.18, 0.38)
LOBE_SHARPNESS = (6.0, 26.0)

_AT_ONCE = 2048
"""Points of one part of a gradient, whose values stay in the processor's cache."""

_EXTENT_SUBDIVISIONS = 4
"""2562 directions, about 4 degrees apart."""
SEGMENTS = 24
"""Points per ring around the tool's axis."""
PROFILE_MM = (
    # (from the tip back along the axis, half width in x, half thickness in y)
    (0.15, 0.45, 0.20),
    (0.50, 0.80, 0.34),
    (1.10, 1.10, 0.40),
    (2.00, 1.25, 0.40),
    (14.0, 1.25, 0.45),
    (18.0, 1.40, 1.40),
    (62.0, 1.40, 1.40),
    (66.0, 3.50, 3.50),
    (72.0, 5.00, 5.00),
    (110.0, 6.00, 6.00),
    (128.0, 5.00, 5.00),
    (130.0, 3.00, 3.00),
)
"""The tool's outline. The rings of the blade are flat ellipses, all others circles."""
RING_SPACING_MM = 2.6
"""Maximum distance between rings on the part that comes near the tumour."""
NEAR_PART_MM = 66.0
_FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
_HEADER = b"binary STL, mm".ljust(80)


@dataclass(frozen=True, slots=True, eq=False)
class Tumour:
    """A star-shaped solid around the origin of the frame ``tumor``.

    The radius of its surface in the unit direction ``u`` is that of an ellipsoid times lobes::

        r(u) = 1 / |u / semi_axes| * (1 + sum_i height_i exp(sharpness_i (u . centre_i - 1)))

    ``semi_axes_mm`` (3,); ``lobe_centres`` (k, 3) unit; ``lobe_heights`` (k,) without unit;
    ``lobe_sharpness`` (k,) without unit. A point is inside exactly when it is nearer to the origin
    than ``r``, so the sign of a distance needs neither a mesh nor a collision library.
    """

    semi_axes_mm: FloatArray
    lobe_centres: FloatArray
    lobe_heights: FloatArray
    lobe_sharpness: FloatArray

    @classmethod
    def generate(cls, random: np.random.Generator) -> "Tumour":
        """A random lobulated tumour with a diameter of about 25 to 35 mm."""
        centres = random.normal(size=(LOBE_COUNT, 3))
        return cls(
            np.array(SEMI_AXES_MM),
            centres / np.linalg.norm(centres, axis=1, keepdims=True),
            random.uniform(*LOBE_HEIGHT, size=LOBE_COUNT),
            random.uniform(*LOBE_SHARPNESS, size=LOBE_COUNT),
        )

    def with_diameter(self, diameter_mm: float) -> "Tumour":
        """The same shape, with this largest diameter through the origin."""
        directions, _ = icosphere(_EXTENT_SUBDIVISIONS)
        extents = self.radius_mm(directions) + self.radius_mm(-directions)
        return replace(self, semi_axes_mm=self.semi_axes_mm * (diameter_mm / extents.max()))

    @property
    def min_radius_mm(self) -> float:
        """The smallest radius of the surface."""
        return float(self.radius_mm(icosphere(_EXTENT_SUBDIVISIONS)[0]).min())

    @property
    def max_radius_mm(self) -> float:
        """The largest radius of the surface."""
        return float(self.radius_mm(icosphere(_EXTENT_SUBDIVISIONS)[0]).max())

    def radius_mm(self, directions: FloatArray) -> FloatArray:
        """Radius (n,) of the surface along unit ``directions`` (n, 3)."""
        ellipsoid = 1.0 / np.linalg.norm(directions / self.semi_axes_mm, axis=1)
        lobes = np.exp(self.lobe_sharpness * (directions @ self.lobe_centres.T - 1.0))
        return np.asarray(ellipsoid * (1.0 + lobes @ self.lobe_heights))

    def surface_mm(self, directions: FloatArray) -> FloatArray:
        """Points (n, 3) of the surface along unit ``directions`` (n, 3)."""
        return directions * self.radius_mm(directions)[:, None]

    def height_mm(self, points_mm: FloatArray) -> FloatArray:
        """Height (n,) of points (n, 3) above the surface along their rays; negative inside.

        The sign is exact. The size is the distance to the surface or more: more where the surface
        is oblique to the ray.
        """
        distance = np.linalg.norm(points_mm, axis=1)
        # The origin has no direction; it is inside for any.
        safe = np.where(distance > 0.0, distance, 1.0)[:, None]
        directions = np.where(distance[:, None] > 0.0, points_mm / safe, (0.0, 0.0, 1.0))
        return np.asarray(distance - self.radius_mm(directions))

    def normals(self, surface_mm: FloatArray) -> FloatArray:
        """Outward unit normals (n, 3) at points (n, 3) of the surface: the gradient of height."""
        normals = np.empty_like(surface_mm)
        for first in range(0, len(surface_mm), _AT_ONCE):
            part = slice(first, first + _AT_ONCE)
            normals[part] = self._gradients(surface_mm[part])
        return np.asarray(normals / np.linalg.norm(normals, axis=1, keepdims=True))

    def _gradients(self, points_mm: FloatArray) -> FloatArray:
        """The gradient (n, 3) of `height_mm` at points (n, 3) other than the origin.

        The radius is the product of ellipsoid and lobes, functions of the direction, of which only
        the part across the ray counts.
        """
        distance = np.linalg.norm(points_mm, axis=1, keepdims=True)
        directions = points_mm / distance
        scaled = directions / self.semi_axes_mm
        ellipsoid = 1.0 / np.linalg.norm(scaled, axis=1, keepdims=True)
        lobes = np.exp(self.lobe_sharpness * (directions @ self.lobe_centres.T - 1.0))
        lobes *= self.lobe_heights
        slopes = (ellipsoid * lobes * self.lobe_sharpness) @ self.lobe_centres
        slopes -= (
            ellipsoid**3 * (1.0 + lobes.sum(axis=1, keepdims=True)) * scaled / self.semi_axes_mm
        )
        along = np.einsum("ij,ij->i", slopes, directions)[:, None] * directions
        return np.asarray(directions - (slopes - along) / distance)

    def mesh(self, subdivisions: int = 5) -> SurfaceMesh:
        """The closed surface with ``20 * 4**subdivisions`` triangles, normals outward."""
        directions, faces = icosphere(subdivisions)
        return SurfaceMesh(TUMOR_FRAME, self.surface_mm(directions), faces.astype(np.int32))


@cache
def icosphere(subdivisions: int) -> tuple[FloatArray, IndexArray]:
    """Evenly spread unit directions (n, 3), and triangles (20 * 4**subdivisions, 3) over them.

    Every triangle of an icosahedron is split into four, ``subdivisions`` times. Both are read-only.
    """
    golden = (1.0 + 5.0**0.5) / 2.0
    rectangle = np.array([[0.0, a, b * golden] for a in (-1.0, 1.0) for b in (-1.0, 1.0)])
    vertices = np.concatenate([np.roll(rectangle, shift, axis=1) for shift in range(3)])
    # The faces of the icosahedron are the triples of vertices with mutual distance 2, its edge.
    near = np.isclose(np.linalg.norm(vertices[:, None] - vertices[None], axis=2), 2.0)
    corners = range(len(vertices))
    triples = [
        (a, b, c)
        for a in corners
        for b in corners[a + 1 :]
        for c in corners[b + 1 :]
        if near[a, b] and near[b, c] and near[a, c]
    ]
    faces = np.array(triples, dtype=np.int64)
    inward = np.linalg.det(vertices[faces]) < 0.0
    faces[inward] = faces[inward][:, ::-1]
    vertices /= np.linalg.norm(vertices, axis=1, keepdims=True)
    for _ in range(subdivisions):
        vertices, faces = _subdivided(vertices, faces)
    vertices.setflags(write=False)
    faces.setflags(write=False)
    return vertices, faces


def _subdivided(vertices: FloatArray, faces: IndexArray) -> tuple[FloatArray, IndexArray]:
    edges = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    unique, edge_of = np.unique(edges, axis=0, return_inverse=True)
    middles = vertices[unique].sum(axis=1)
    middles /= np.linalg.norm(middles, axis=1, keepdims=True)
    ab, bc, ca = (len(vertices) + edge_of.reshape(-1, 3)).T
    a, b, c = faces.T
    cut = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
    return np.concatenate([vertices, middles]), np.concatenate([np.stack(t, 1) for t in cut])


@cache
def tool_mesh() -> SurfaceMesh:
    """The tool in `TIP_FRAME`: tip at the origin, +z forward, the handle along -z."""
    behind_mm, half_x_mm, half_y_mm = _rings()
    angles = np.arange(SEGMENTS) * (2.0 * np.pi / SEGMENTS)
    rings = np.empty((len(behind_mm), SEGMENTS, 3))
    rings[..., 0] = half_x_mm[:, None] * np.cos(angles)
    rings[..., 1] = half_y_mm[:, None] * np.sin(angles)
    rings[..., 2] = -behind_mm[:, None]
    back = (0.0, 0.0, -float(behind_mm[-1]))
    vertices = np.concatenate([[(0.0, 0.0, 0.0)], rings.reshape(-1, 3), [back]])

    def index(ring: int, segment: int) -> int:
        return 1 + ring * SEGMENTS + segment % SEGMENTS

    last, end = len(behind_mm) - 1, len(vertices) - 1
    faces = [(0, index(0, s), index(0, s + 1)) for s in range(SEGMENTS)]
    for ring in range(last):
        for s in range(SEGMENTS):
            faces.append((index(ring, s), index(ring + 1, s), index(ring, s + 1)))
            faces.append((index(ring, s + 1), index(ring + 1, s), index(ring + 1, s + 1)))
    faces += [(end, index(last, s + 1), index(last, s)) for s in range(SEGMENTS)]
    return SurfaceMesh(TIP_FRAME, vertices, np.array(faces))


def _rings() -> tuple[FloatArray, FloatArray, FloatArray]:
    behind_mm, half_x_mm, half_y_mm = np.array(PROFILE_MM).T
    knots = [behind_mm[:1]]
    for start, stop in pairwise(behind_mm.tolist()):
        spacing = RING_SPACING_MM if stop <= NEAR_PART_MM else 4.0 * RING_SPACING_MM
        count = max(1, int(np.ceil((stop - start) / spacing)))
        knots.append(np.linspace(start, stop, count + 1)[1:])
    rings = np.concatenate(knots)
    return rings, np.interp(rings, behind_mm, half_x_mm), np.interp(rings, behind_mm, half_y_mm)


def write_stl(path: Path, mesh: SurfaceMesh) -> None:
    """Write ``mesh`` to ``path`` in mm, single precision, with the normals of its faces."""
    corners = mesh.triangles_mm
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    facets = np.zeros(len(corners), dtype=_FACET)
    facets["normal"] = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    facets["corners"] = corners
    path.write_bytes(_HEADER + np.uint32(len(facets)).astype("<u4").tobytes() + facets.tobytes())
