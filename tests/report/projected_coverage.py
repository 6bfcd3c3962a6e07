"""View of the coverage as a page shows it, computed apart from `web/coverage.js`.

The patient is turned by rotation matrices, and every face of the surface is tried at every point:
no face is left out for its side, and none is drawn over another.
"""

import base64
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

SURFACE, LABELS = 0.78, 0.92
"""Shares of half the picture that the surface and the letters of the sides reach."""


@dataclass
class View:
    """The angles in degrees and the zoom that the reader has reached."""

    azimuth: float
    elevation: float
    zoom: float = 1.0


class Projection:
    """The surface of a page's data in a picture of ``width`` and ``height`` pixels."""

    def __init__(self, document, width, height):
        self.document, self.middle = document, np.array([width, height]) / 2.0
        self.half = min(width, height) / 2.0
        self.vertices = np.frombuffer(base64.b64decode(document["vertices"]), "<i2").reshape(-1, 3)
        self.vertices = self.vertices * document["vertex_mm"]
        self.faces = np.frombuffer(base64.b64decode(document["faces"]), "<u2").reshape(-1, 3)
        steps = np.frombuffer(base64.b64decode(document["nearest"]), "<u2")
        self.nearest = [None if s == document["farther"] else s / 1000.0 for s in steps.tolist()]

    def camera(self, view):
        """Patient (right, anterior, superior) to picture (right, up, towards the reader)."""
        facing = np.array([[-1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 1.0, 0.0]])  # from anterior
        about_superior = Rotation.from_euler("z", view.azimuth, degrees=True).as_matrix()
        tilted = Rotation.from_euler("x", view.elevation, degrees=True).as_matrix()
        return tilted @ facing @ about_superior

    def places(self, points, view):
        """Pixels and depth (n, 3) of ``points`` (n, 3) in mm."""
        turned = np.asarray(points) @ self.camera(view).T
        reach = np.linalg.norm(self.vertices, axis=1).max()
        scale = SURFACE * self.half * view.zoom / reach
        x, y, depth = turned.T
        return np.stack([self.middle[0] + scale * x, self.middle[1] - scale * y, depth], axis=1)

    def letters(self, view):
        """Pixels (6, 2) of the letters of the sides."""
        axes = np.array([side["axis"] for side in self.document["sides"]]) @ self.camera(view).T
        return self.middle + LABELS * self.half * axes[:, :2] * [1.0, -1.0]

    def marks(self, view):
        """Pixels (b, 2) of the places of the breaches, also of those behind the surface."""
        places = [breach["place"] for breach in self.document["breaches"]]
        return self.places(places, view)[:, :2]

    def seen(self, pixels, view):
        """Index of the face that is seen at each of ``pixels`` (k, 2); -1 beside the surface."""
        corners = self.places(self.vertices, view)[self.faces]
        low, high = corners[..., :2].min(axis=1), corners[..., :2].max(axis=1)
        pixels = np.asarray(pixels, dtype=float)
        near = np.ones((len(pixels), len(corners)), dtype=bool)
        for axis in range(2):
            across = pixels[:, axis, None]
            near &= (low[:, axis] <= across) & (across <= high[:, axis])
        index, face = np.nonzero(near)
        pixel, (a, b, c) = pixels[index], (corners[face, k, :2] for k in range(3))
        parts = np.stack([_area(pixel, b, c), _area(a, pixel, c), _area(a, b, pixel)], axis=1)
        with np.errstate(divide="ignore", invalid="ignore"):
            weights = parts / parts.sum(axis=1)[:, None]
        depth = (weights * corners[face, :, 2]).sum(axis=1)
        hit = np.flatnonzero((weights >= 0.0).all(axis=1))
        hit = hit[depth[hit].argsort()]  # the nearest face comes last, and remains
        found = np.full(len(pixels), -1)
        found[index[hit]] = face[hit]
        return found

    def color(self, face, view):
        """Red, green and blue of ``face``, 0 to 255."""
        a, b, c = self.vertices[self.faces[face]] @ self.camera(view).T
        normal = np.cross(b - a, c - a)
        light = self.document["ambient"] + self.document["direct"] * normal[2] / np.linalg.norm(
            normal
        )
        nearest = self.nearest[face]
        limits = self.document["within_mm"]
        number = len(limits) if nearest is None else sum(nearest > limit for limit in limits)
        base = self.document["colors"][number]
        return np.array([int(base[k : k + 2], 16) for k in (1, 3, 5)]) * light

    def texts(self, face):
        """The possible texts of the page on ``face``: a half is rounded to either side."""
        if face < 0:
            return {"not on the tumour"}
        nearest = self.nearest[face]
        if nearest is None:
            return {"farther than 10 mm"}
        return {f"{nearest + off:.2f} mm" for off in (-1e-6, 1e-6)}


def _area(a, b, c):
    """Twice the signed area of triangles in the plane."""
    p, q = b - a, c - a
    return p[..., 0] * q[..., 1] - p[..., 1] * q[..., 0]
