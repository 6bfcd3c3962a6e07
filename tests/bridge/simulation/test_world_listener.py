"""A simulated world as a page receives it, and requests, against a world that the test steps."""

import numpy as np
import pytest

from app.bridge.simulation import NODE_NAME
from app.bridge.simulation.world_bodies import MAX_ALL_TRIANGLES
from app.bridge.world_client import WorldListener
from app.geometry import Transform
from app.runtime import BodyKind, RequestOutcome, SimulatedWorld
from app.simulation import open_world
from tests.bridge.nodes import ros_nodes
from tests.bridge.simulation.test_body_edits import Edited, cube, now

pytestmark = pytest.mark.slow

KINDS = {"chest_wall": BodyKind.FIXED, "tumor": BodyKind.TISSUE, "cautery": BodyKind.TOOL}


@pytest.fixture
def description(project_root):
    return open_world(project_root / "data" / "worlds" / "lumpectomy")


@pytest.fixture
def world():
    return SimulatedWorld("world", "tracker", lambda: now().ns)


@pytest.fixture
def edited(domain_id, description, world):
    with ros_nodes(domain_id, NODE_NAME, "page") as (ros, page):
        found = Edited(ros, page, description)
        WorldListener(page, NODE_NAME, world)
        found.until(lambda: world.moment().is_connected and len(world.moment().poses) == len(KINDS))
        yield found


def kinds(world):
    return {each.name: each.kind for each in world.moment().bodies}


def outcome(world):
    return world.moment().request.outcome


def test_late_page_gets_the_surfaces_of_the_description(edited, world, description):
    edited.until(lambda: kinds(world) == KINDS)
    meshes = {each.name: each.mesh for each in world.moment().bodies}
    wall = description.bodies[0].mesh
    assert len(meshes["chest_wall"].faces) == len(wall.faces) < MAX_ALL_TRIANGLES
    np.testing.assert_allclose(meshes["chest_wall"].bounds_mm, wall.bounds_mm, atol=1e-9)
    assert meshes["chest_wall"].signed_volume_mm3 == pytest.approx(wall.signed_volume_mm3)


def test_moved_body_is_done_when_the_physics_has_it_there(edited, world):
    world.move("chest_wall", np.array([0.0, 0.0, -10.0]), np.eye(3))
    edited.until(lambda: outcome(world) is RequestOutcome.DONE)
    place = world.moment().poses["chest_wall"].translation_mm
    np.testing.assert_allclose(place, [205, 0, 40], atol=1e-6)
    truth = edited.world.state().bodies["chest_wall"].translation_mm
    np.testing.assert_allclose(place, truth, atol=1e-6)


def test_added_body_has_a_surface_until_it_is_removed(edited, world):
    world.add(cube("clip"), Transform("world", "clip", np.eye(3), np.array([205.0, 200.0, 80.0])))
    edited.until(lambda: outcome(world) is RequestOutcome.DONE)
    assert kinds(world) == {**KINDS, "clip": BodyKind.ADDED}
    world.remove("clip")
    edited.until(lambda: outcome(world) is RequestOutcome.DONE)
    assert kinds(world) == KINDS


@pytest.mark.parametrize(
    ("name", "reason"), [("tumor", "set_tumor alone"), ("cautery", "an arm moves it")]
)
def test_refused_move_has_the_reason_of_the_simulation(edited, world, name, reason):
    def is_refused():
        # The subscription to refusals may come later than those of the requests.
        if world.moment().request is None or outcome(world) is RequestOutcome.UNANSWERED:
            world.move(name, np.array([1.0, 0.0, 0.0]), np.eye(3))
        return outcome(world) is RequestOutcome.REFUSED

    edited.until(is_refused)
    assert reason in world.moment().request.reason
