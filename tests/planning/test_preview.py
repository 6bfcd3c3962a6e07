"""The preview of an approach against coal, and its page."""

import json
import re

import coal
import numpy as np
import pytest
import trimesh

from app.geometry import SurfaceMesh
from app.planning import nearest_structures, plan_approach, preview_approach
from app.report.approach_page import approach_page
from benchmarks.fixture.engines import coal_model
from tests.planning.approach_scenes import CoalScene, limits_of, load

pytestmark = pytest.mark.slow

CLEARANCE_MM = 5.0
CARRIED = "needle"


@pytest.fixture(scope="module")
def robot():
    return load("touch")


@pytest.fixture(scope="module")
def structures(robot):
    shapes = {
        "ball": trimesh.creation.icosphere(3, 25.0).apply_translation([230.0, 70.0, 120.0]),
        "<wall>": trimesh.creation.box((200, 10, 100)).apply_translation([205.0, 200.0, 60.0]),
    }
    return {
        name: SurfaceMesh(robot.root_link, shape.vertices, shape.faces)
        for name, shape in shapes.items()
    }


def carried():
    rod = trimesh.creation.cylinder(2.0, 60.0)
    return SurfaceMesh("stylus", rod.vertices + np.array([0.0, 0.0, 30.0]), rod.faces)


@pytest.fixture(scope="module")
def preview(robot, structures):
    start = dict.fromkeys(robot.actuated_joint_names, 0.0) | {"shoulder": 1.0, "elbow": 0.5}
    approach = plan_approach(
        robot, start, {"waist": 0.6, "shoulder": 0.8}, structures, clearance_mm=CLEARANCE_MM,
        limits=limits_of(robot), carried={CARRIED: carried()}, is_over=lambda: False,
        made_from={"setup_id": "<id>"},
    )  # fmt: skip
    return preview_approach(robot, approach, structures, {CARRIED: carried()})


def test_distances_are_those_of_coal(robot, structures, preview):
    assert (preview.samples[0], preview.samples[-1]) == (0, len(preview.approach.times_ns) - 1)
    scene = CoalScene(robot, structures)
    models = {name: coal_model(mesh.vertices_mm, mesh.faces) for name, mesh in preview.moving}
    still = coal.Transform3s()
    for poses, found in zip(preview.poses[::20], preview.distances_mm[::20], strict=True):
        for (name, _), distance in zip(preview.structures, found, strict=True):
            judged = min(
                scene.distance_mm(
                    models[body],
                    coal.Transform3s(pose[:3, :3].copy(), pose[:3, 3].copy()),
                    scene.structures[name],
                    still,
                )
                for (body, _), pose in zip(preview.moving, poses, strict=True)
                if body != robot.root_link  # nothing moves it against a structure
            )
            assert distance == pytest.approx(judged, abs=1e-3)


def test_nearest_structure_is_that_of_the_smallest_distance(robot, structures, preview):
    approach = preview.approach
    start = dict(zip(approach.joints, approach.positions[0].tolist(), strict=True))
    tip_mm = robot.forward_kinematics({**approach.held, **start})["stylus"].translation_mm
    behind = trimesh.creation.icosphere(2, 5.0).apply_translation(tip_mm - [0.0, 50.0, 0.0])
    mesh = SurfaceMesh(robot.root_link, behind.vertices, behind.faces)
    everything = {**structures, "behind": mesh}, {CARRIED: carried()}
    found = preview_approach(robot, approach, *everything)
    names = [name for name, _ in found.structures]
    nearest = nearest_structures(robot, approach, *everything)
    assert [name for name, _ in found.nearest] == [name for name, _ in nearest]
    assert [mm for _, mm in found.nearest] == pytest.approx([mm for _, mm in nearest], abs=1e-9)
    assert {name for name, _ in nearest} == {"behind", "ball"}
    for (name, distance_mm), row in zip(nearest, found.distances_mm, strict=True):
        assert distance_mm == pytest.approx(row[names.index(name)], abs=1e-9)
        assert distance_mm == pytest.approx(row.min(), abs=1e-9)


def test_page_of_a_scene_without_structures_has_no_distances(robot, preview):
    approach = plan_approach(
        robot, {**preview.approach.held, "waist": 0.0, "shoulder": 1.0}, {"waist": 0.1}, {},
        clearance_mm=CLEARANCE_MM, limits=limits_of(robot), is_over=lambda: False,
    )  # fmt: skip
    assert nearest_structures(robot, approach, {}, {}) == []
    preview = preview_approach(robot, approach, {}, {})
    assert preview.nearest == []
    page = approach_page(preview, "<robot>")
    assert "&lt;robot&gt;: approach" in page
    assert "<h2>Distances</h2>" not in page
    assert "Made from" not in page


def test_page_escapes_texts(preview):
    page = approach_page(preview, "touch")
    assert "<wall>" not in page and "<id>" not in page
    (document,) = re.findall(r'figure class="turning motion".*?json">(.*?)</script>', page, re.S)
    assert json.loads(document)["structures"] == ["ball", "<wall>"]
