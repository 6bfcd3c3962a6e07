"""Phantom images: a simulated tumour cut by the plane of an image, and the clicks on its border."""

import numpy as np
from skimage.filters import gaussian
from skimage.measure import find_contours

from app.synthetic.tumour_and_tool import Tumour

COLUMNS, ROWS = 200, 160
PIXEL_MM = 0.25


def tumour() -> Tumour:
    """A lobulated tumour of 18 mm."""
    return Tumour.generate(np.random.default_rng(5)).with_diameter(18.0)


def tumor_from_image(offset_mm: float) -> np.ndarray:
    """Pose (4, 4) of an image plane at ``offset_mm`` along its normal, oblique to all axes."""
    u, v = np.array([0.8, 0.6, 0.0]), np.array([-0.36, 0.48, 0.8])
    normal = np.cross(u, v)
    pose = np.eye(4)
    pose[:3, :3] = np.column_stack([PIXEL_MM * u, PIXEL_MM * v, normal])
    pose[:3, 3] = offset_mm * normal - pose[:3, :2] @ [COLUMNS / 2, ROWS / 2]
    return pose


def is_inside(solid: Tumour, points_mm: np.ndarray) -> np.ndarray:
    """True (n,) for the points (n, 3) in the tumour."""
    places = points_mm + 1e-9  # no direction is zero
    radius = np.linalg.norm(places, axis=1)
    return radius < solid.radius_mm(places / radius[:, None])


def slice_of(solid: Tumour, pose: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """The image (rows, columns) of 8 bits: a dark lesion in bright tissue, with speckle."""
    row, column = np.mgrid[:ROWS, :COLUMNS]
    pixels = np.stack([column, row, np.zeros_like(row), np.ones_like(row)], axis=-1)
    places = (pixels @ pose.T)[..., :3].reshape(-1, 3)
    level = np.where(is_inside(solid, places).reshape(ROWS, COLUMNS), 45.0, 130.0)
    speckle = random.rayleigh(0.8, size=level.shape)
    return np.clip(level * speckle, 0, 255).astype(np.uint8)


def clicks_on(image: np.ndarray, count: int) -> list[tuple[int, int]]:
    """Up to ``count`` columns and rows on the lesion's border, of the pixels alone."""
    smooth = gaussian(image.astype(float), 3.0)
    found = [line for line in find_contours(smooth, 75.0) if len(line) > 30]
    if not found:
        return []
    line = max(found, key=len)
    picked = line[np.linspace(0, len(line) - 1, count, endpoint=False).astype(int)]
    return [(round(column), round(row)) for row, column in picked.tolist()]


def dice(contains_a: np.ndarray, contains_b: np.ndarray) -> float:
    """Dice coefficient of two solids by the grid's points in each."""
    return 2.0 * float((contains_a & contains_b).sum()) / float(contains_a.sum() + contains_b.sum())
