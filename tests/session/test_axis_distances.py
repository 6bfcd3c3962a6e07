"""Distances along the axes, against closed forms, a ray search and steps of the exact distance."""

import numpy as np
import pytest
import trimesh

from app.fixture import TipProximity, margin_surface
from app.geometry import ANATOMICAL_AXES, InputError, SurfaceMesh, Transform
from app.session import AxisDistances


def mesh_of(shape: trimesh.Trimesh) -> SurfaceMesh:
    return SurfaceMesh("tumor", np.asarray(shape.vertices), np.asarray(shape.faces))


@pytest.fixture(scope="module")
def blob() -> SurfaceMesh:
    """A bumpy body that is not convex."""
    shape = trimesh.creation.icosphere(subdivisions=3, radius=1.0)
    x, y, z = shape.vertices.T
    shape.vertices *= (9.0 + 2.5 * np.sin(3.0 * x) * np.cos(2.0 * y) + 2.0 * z * x)[:, None]
    return mesh_of(shape)


def first_hit(mesh: SurfaceMesh, point: np.ndarray, direction: np.ndarray) -> float | None:
    """Nearest hit by Moeller and Trumbore's test of every triangle; negative where it leaves."""
    a, b, c = (mesh.vertices_mm[mesh.faces[:, k]] for k in range(3))
    side, other = b - a, c - a
    p = np.cross(direction, other)
    det = (side * p).sum(axis=1)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        s = point - a
        u = (s * p).sum(axis=1) / det
        q = np.cross(s, side)
        v = (q @ direction) / det
        t = (other * q).sum(axis=1) / det
        hits = (np.abs(det) > 1e-14) & (u >= 0) & (v >= 0) & (u + v <= 1) & (t >= 0)
    if not hits.any():
        return None
    best = min(np.flatnonzero(hits), key=lambda n: t[n])
    return float(-t[best] if np.cross(side, other)[best] @ direction > 0 else t[best])


def test_distances_are_those_of_a_ray_search(blob):
    random = np.random.default_rng(3)
    distances, kinds = AxisDistances(blob), set()
    for point in random.uniform(-16.0, 16.0, (300, 3)):
        for letter, found in distances.at(point).items():
            expected = first_hit(blob, point, ANATOMICAL_AXES[letter])
            kinds.add(None if expected is None else expected > 0.0)
            assert found == (None if expected is None else pytest.approx(expected, abs=1e-9))
    assert kinds == {None, True, False}


def test_distances_to_the_stop_margin_are_those_of_steps_by_the_exact_distance(blob):
    """Each step along the ray is as long as the exact distance to the margin: it passes nothing."""
    stop_mm, exact = 2.0, TipProximity(blob)
    surface = margin_surface(blob, stop_mm, spacing_mm=1.0)
    distances, differences = AxisDistances(surface), []

    def to_margin(point: np.ndarray) -> float:
        pose = Transform("tumor", "tip", np.eye(3), point)
        return exact.evaluate(pose).signed_distance_mm - stop_mm

    for point in np.random.default_rng(4).uniform(-13.0, 13.0, (25, 3)):
        sign = 1.0 if to_margin(point) > 0.0 else -1.0
        for letter, found in distances.at(point).items():
            way, rest = 0.0, np.inf
            while way < 60.0 and rest > 1e-3:
                rest = sign * to_margin(point + way * ANATOMICAL_AXES[letter])
                way += max(rest, 1e-3)
            if way < 60.0 and found is not None:
                # Where the ray grazes the surface, its spacing of 1 mm matters along the ray.
                assert found * sign > 0.0
                assert abs(to_margin(point + abs(found) * ANATOMICAL_AXES[letter])) < 0.2
                differences.append(abs(abs(found) - way))
    assert len(differences) > 60 and np.median(differences) < 0.05


def test_ball_and_box_have_their_closed_forms():
    box = AxisDistances(mesh_of(trimesh.creation.box((20.0, 10.0, 6.0))))
    inside = box.at(np.array([1.0, 2.0, -1.0]))
    assert inside == pytest.approx(
        {"R": -9.0, "L": -11.0, "A": -3.0, "P": -7.0, "S": -4.0, "I": -2.0}
    )
    beside = box.at(np.array([14.0, 0.0, 0.0]))
    assert beside == {"R": None, "L": 4.0, "A": None, "P": None, "S": None, "I": None}
    ball = AxisDistances(mesh_of(trimesh.creation.icosphere(subdivisions=5, radius=8.0)))
    above = ball.at(np.array([3.0, 2.0, 20.0]))
    assert above["I"] == pytest.approx(20.0 - np.sqrt(64.0 - 13.0), abs=0.02)


def test_ray_through_edges_and_corners_meets_the_surface():
    box = AxisDistances(mesh_of(trimesh.creation.box((2.0, 2.0, 2.0))))
    for point in ([0.0, 0.0, 5.0], [0.5, 0.5, 5.0], [1.0, 1.0, 5.0]):
        assert box.at(np.array(point))["I"] == pytest.approx(4.0)


def test_point_that_is_not_finite_is_refused(blob):
    with pytest.raises(InputError, match="expected three finite numbers"):
        AxisDistances(blob).at(np.array([0.0, np.nan, 0.0]))
