"""Random poses of a tool that are difficult for an engine: grazing, nested, and arbitrary ones."""

from dataclasses import dataclass

import numpy as np
import trimesh
from scipy.spatial.transform import Rotation

from app.geometry import FloatArray, SurfaceMesh, Transform

_SHARES = {"anywhere": 0.4, "grazing": 0.35, "nested": 0.25}
_SAMPLES = 20_000


@dataclass(frozen=True, eq=False)
class PoseSource:
    """Draws poses of ``tool`` in the frame of ``tumor``, from points on both with their normals.

    - anywhere: any rotation, with an offset of the origins of about 7 mm along each axis;
    - grazing: a point of one surface at a point of the other within about 0.3 mm, with opposite
      normals;
    - nested: a point of the tool's box near the tumour's centre, which puts a small tool wholly
      inside the tumour, and the tumour wholly inside a large tool.
    """

    tumor: SurfaceMesh
    tool: SurfaceMesh
    tumor_samples: tuple[FloatArray, FloatArray]
    tool_samples: tuple[FloatArray, FloatArray]

    @classmethod
    def of(cls, tumor: SurfaceMesh, tool: SurfaceMesh) -> "PoseSource":
        """Sample both surfaces uniformly by area."""
        return cls(tumor, tool, _samples(tumor), _samples(tool))

    def draw(self, rng: np.random.Generator, count: int) -> list[Transform]:
        """``count`` poses of all three kinds, mixed."""
        kind = rng.choice(list(_SHARES), size=count, p=list(_SHARES.values()))
        rotations = Rotation.from_quat(rng.normal(size=(count, 4))).as_matrix()
        translations = rng.normal(scale=7.0, size=(count, 3))
        nested = kind == "nested"
        translations[nested] = self._nested(rng, rotations[nested])
        grazing = kind == "grazing"
        rotations[grazing], translations[grazing] = self._grazing(rng, int(grazing.sum()))
        return [
            Transform(self.tumor.frame, self.tool.frame, rotation, translation)
            for rotation, translation in zip(rotations, translations, strict=True)
        ]

    def _nested(self, rng: np.random.Generator, rotations: FloatArray) -> FloatArray:
        near, far = self.tool.bounds_mm
        shares = rng.uniform(0.15, 0.85, size=(len(rotations), 3))
        middle = 0.5 * np.add(*self.tumor.bounds_mm)
        places = middle + rng.normal(scale=2.5, size=(len(rotations), 3))
        return np.asarray(places - _rotated(rotations, near + shares * (far - near)))

    def _grazing(self, rng: np.random.Generator, count: int) -> tuple[FloatArray, FloatArray]:
        here, there = rng.integers(_SAMPLES, size=(2, count))
        points, normals = (values[here] for values in self.tumor_samples)
        tool_points, tool_normals = (values[there] for values in self.tool_samples)
        back_to_back = _bases(rng, -normals) @ _bases(rng, tool_normals).transpose(0, 2, 1)
        tilts = Rotation.from_rotvec(rng.normal(scale=0.1, size=(count, 3))).as_matrix()
        rotations = tilts @ back_to_back
        gaps = rng.normal(scale=0.3, size=(count, 1))
        return rotations, points + gaps * normals - _rotated(rotations, tool_points)


def _bases(rng: np.random.Generator, normals: FloatArray) -> FloatArray:
    """Rotations (n, 3, 3) with ``normals`` as first columns and random second ones."""
    second = np.cross(normals, rng.normal(size=normals.shape))
    second /= np.linalg.norm(second, axis=1, keepdims=True)
    return np.stack([normals, second, np.cross(normals, second)], axis=2)


def _rotated(rotations: FloatArray, points: FloatArray) -> FloatArray:
    return np.asarray(np.einsum("kij,kj->ki", rotations, points))


def _samples(mesh: SurfaceMesh) -> tuple[FloatArray, FloatArray]:
    shape = trimesh.Trimesh(mesh.vertices_mm, mesh.faces, process=False)
    points, faces = trimesh.sample.sample_surface(shape, _SAMPLES, seed=1)
    return np.asarray(points), np.asarray(shape.face_normals[faces])
