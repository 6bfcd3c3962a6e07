"""The deepest point of an interpolated path, compared with dense sampling of the same path."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
import trimesh

from app.fixture import MarginState, Proximity, TipProximity, Witnesses
from app.geometry import InputError, Stamp, SurfaceMesh, TrackedTransform, TrackingStatus, Transform
from app.session import PathPoint, Session, SessionSetup, deepest_on_path
from tests.doubles import PARAMETERS, frame

RADIUS_MM = 10.0
SHAFT_MM = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, -40.0], [0.0, 15.0, -80.0]])
"""Points of a tool: its signed distance to the sphere is exact."""
REACH_MM = float(np.linalg.norm(SHAFT_MM, axis=1).max())


def measured(pose: Transform) -> Proximity:
    points = np.array([pose.apply(point) for point in SHAFT_MM])
    distances = np.linalg.norm(points, axis=1) - RADIUS_MM
    at = int(np.argmin(distances))
    normal = points[at] / np.linalg.norm(points[at])
    witness = Witnesses.single(float(distances[at]), points[at], RADIUS_MM * normal, normal)
    return Proximity(float(distances[at]), witness, None)


def point(pose: Transform, at_ms: int) -> PathPoint:
    return PathPoint(Stamp(at_ms * 1_000_000), pose, measured(pose))


def dense_minimum_mm(poses: list[Transform]) -> float:
    return min(
        measured(first.interpolate(last, fraction)).signed_distance_mm
        for first, last in pairwise(poses)
        for fraction in np.linspace(0.0, 1.0, 150)
    )


def test_estimate_and_bound_enclose_the_minimum_of_random_paths():
    rng = np.random.default_rng(4)
    for _ in range(8):
        poses = [
            Transform.from_rotation_vector(
                rng.normal(0.0, 0.6, 3), rng.normal(0.0, 25.0, 3), target="tumor", source="tip"
            )
            for _ in range(3)
        ]
        path = [point(pose, 20 * index) for index, pose in enumerate(poses)]
        found = deepest_on_path(
            path, measured, radius_mm=REACH_MM, tolerance_mm=0.1, max_evaluations=3000
        )
        true_mm = dense_minimum_mm(poses)
        estimate_mm = found.deepest.proximity.signed_distance_mm
        assert found.lower_bound_mm <= true_mm + 1e-9
        assert found.lower_bound_mm >= estimate_mm - 0.1 - 1e-9
        assert estimate_mm <= true_mm + 0.1 + 1e-9


def test_bound_holds_when_the_evaluations_are_used_up():
    poses = [
        Transform("tumor", "tip", np.eye(3), position) for position in ([-60, 6, 0], [60, 6, 0])
    ]
    path = [point(pose, 20 * index) for index, pose in enumerate(poses)]
    found = deepest_on_path(
        path, measured, radius_mm=REACH_MM, tolerance_mm=0.01, max_evaluations=3
    )
    assert found.lower_bound_mm <= dense_minimum_mm(poses)
    assert found.lower_bound_mm < found.deepest.proximity.signed_distance_mm - 0.01
    assert found.end is path[-1]


@pytest.mark.parametrize("loose_mm", [(0.0, 50.0), (50.0, 0.0)])
def test_loose_bound_at_an_end_leads_to_no_pose_beyond_it(loose_mm):
    path = []
    for x_mm, by_mm in zip((20.0, 21.0), loose_mm, strict=True):
        pose = Transform("tumor", "tip", np.eye(3), [x_mm, 0.0, 0.0])
        exact = measured(pose)
        bounded = replace(exact, lower_bound_mm=exact.lower_bound_mm - by_mm)
        path.append(PathPoint(Stamp(0), pose, bounded))
    evaluated = []

    def record(pose: Transform) -> Proximity:
        evaluated.append(pose.translation_mm[0])
        return measured(pose)

    deepest_on_path(path, record, radius_mm=REACH_MM, tolerance_mm=0.1, max_evaluations=3)
    assert len(evaluated) == 3
    assert 20.0 < min(evaluated) < max(evaluated) < 21.0


def test_path_without_a_point_is_refused():
    with pytest.raises(InputError, match="there are 0; expected at least 1"):
        deepest_on_path([], measured, radius_mm=1.0, tolerance_mm=0.1, max_evaluations=1)


@pytest.fixture(scope="module")
def ball() -> TipProximity:
    mesh = trimesh.creation.icosphere(subdivisions=4, radius=RADIUS_MM)
    return TipProximity(SurfaceMesh("tumor", mesh.vertices, mesh.faces))


def passing(ball: TipProximity):
    """Two frames on both sides of the ball; the straight path is 3.87 mm deep in its middle."""
    setup = SessionSetup(
        Transform.identity("cautery", "cautery_tip"),
        Transform.identity("reference", "tumor"),
        ball,
        PARAMETERS,
        None,
    )
    session = Session(setup)
    return [
        session.step(
            frame(
                at_ms,
                TrackedTransform(
                    Transform("reference", "cautery", np.eye(3), [x_mm, RADIUS_MM - 3.87, 0.0]),
                    Stamp(at_ms * 1_000_000),
                    TrackingStatus.OK,
                ),
            )
        )
        for at_ms, x_mm in ((0, -14.0), (20, 14.0))
    ]


def test_first_contact_of_the_sweep_is_not_the_reported_depth(ball):
    first, last = passing(ball)
    contact = ball.sweep(first.tumor_from_tip, last.tumor_from_tip).lowest
    assert -1.0 < contact.signed_distance_mm <= 0.0
    assert first.between_frames is None
    decision, between = last.decision, last.between_frames
    assert decision.state is MarginState.POSITIVE
    assert decision.proximity.signed_distance_mm == pytest.approx(-3.87, abs=0.15)
    assert decision.proximity.lower_bound_mm == between.lower_bound_mm <= -3.86
    assert between.deepest.stamp.ns == pytest.approx(10_000_000, abs=1_500_000)
    assert between.end.proximity.signed_distance_mm > 0.0
