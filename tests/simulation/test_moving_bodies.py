"""Bodies that are moved, added and removed while the world runs."""

from dataclasses import replace

import numpy as np
import pytest

from app.geometry import Transform
from app.simulation import BodyEntry, EditError, World, WorldDescription, open_world
from tests.simulation.conftest import LUMPECTOMY, box, placed

pytestmark = pytest.mark.slow


def at(name, x, y=0.0, z=0.0):
    return placed(name, x, y, z)


def cube(name, pose, mass_kg=None):
    return BodyEntry(name, box(name, 20, 20, 20), pose, mass_kg)


def world_with(*bodies, gravity=0.0):
    return World(WorldDescription("boxes", 1, gravity_m_s2=gravity, bodies=bodies))


def steps(world, count):
    for _ in range(count):
        state = world.step()
    return state


def test_moved_bodies_are_where_they_were_put():
    world = world_with(cube("wall", at("wall", 0)), cube("ball", at("ball", 100), 0.1))
    turned = Transform.from_rotation_vector(
        [0.1, 0.2, 0.3], [50.0, 60.0, 70.0], target="world", source="wall"
    )
    state = world.move_bodies({"wall": turned, "ball": at("ball", -80)})
    for found in (state, steps(world, 5)):
        np.testing.assert_allclose(found.bodies["wall"].matrix, turned.matrix, atol=1e-9)
        np.testing.assert_allclose(found.bodies["ball"].translation_mm, [-80, 0, 0], atol=1e-6)


def test_moved_obstacle_pushes_back_and_reset_puts_it_back():
    falling = cube("box", at("box", 0, 0, 40), 0.1)
    world = world_with(cube("table", at("table", 500)), falling, gravity=9.8)
    world.move_bodies({"table": at("table", 0)})
    assert steps(world, 300).bodies["box"].translation_mm[2] == pytest.approx(20.0, abs=0.2)
    state = world.reset()
    np.testing.assert_allclose(state.bodies["table"].translation_mm, [500, 0, 0], atol=1e-9)
    assert steps(world, 500).bodies["box"].translation_mm[2] < -100.0


@pytest.mark.parametrize(
    ("name", "pose", "problem"),
    [
        ("nothing", at("nothing", 0), "no such body; expected one of wall, ball"),
        ("ball", Transform.identity("wall", "ball"), "frame 'wall'; expected 'world'"),
        ("ball", at("ball", 5), r"overlaps '(wall|ball)' by 16\.0 mm; expected at most 1 mm"),
    ],
)
def test_refused_move_changes_nothing(name, pose, problem):
    world = world_with(cube("wall", at("wall", 0)), cube("ball", at("ball", 100), 0.1))
    with pytest.raises(EditError, match=problem):
        world.move_bodies({"wall": at("wall", 1), name: pose})
    state = steps(world, 3)
    np.testing.assert_allclose(state.bodies["wall"].translation_mm, 0.0, atol=1e-9)
    np.testing.assert_allclose(state.bodies["ball"].translation_mm, [100, 0, 0], atol=1e-6)


def test_added_and_removed_bodies_leave_the_states_of_the_others():
    ball = cube("ball", at("ball", 100), 0.1)
    world = world_with(cube("wall", at("wall", 0)), ball)
    world.move_bodies({"wall": at("wall", -50), "ball": at("ball", 60)})
    time_ns = world.time_ns
    state = world.change_bodies((*world.description.bodies, cube("new", at("new", 200))))
    assert set(state.bodies) == {"wall", "ball", "new"}
    np.testing.assert_allclose(state.bodies["wall"].translation_mm, [-50, 0, 0], atol=1e-9)
    np.testing.assert_allclose(state.bodies["ball"].translation_mm, [60, 0, 0], atol=1e-9)
    assert world.time_ns == time_ns
    state = world.change_bodies((ball,))
    assert set(steps(world, 3).bodies) == {"ball"}


def test_refused_addition_changes_nothing():
    world = world_with(cube("wall", at("wall", 0)))
    overlapping = cube("ball", at("ball", 15), 0.1)
    with pytest.raises(EditError, match=r"'ball' overlaps 'wall' by 5\.0 mm"):
        world.change_bodies((*world.description.bodies, overlapping))
    flat = replace(overlapping.mesh, vertices_mm=overlapping.mesh.vertices_mm * [1.0, 1.0, 0.0])
    with pytest.raises(EditError):
        world.change_bodies((*world.description.bodies, replace(overlapping, mesh=flat)))
    assert set(steps(world, 3).bodies) == {"wall"}


def test_body_that_the_hand_pushes_at_is_not_removed():
    about = open_world(LUMPECTOMY)
    pushes = (replace(about.hand.pushes[0], towards="chest_wall"),)
    world = World(replace(about, hand=replace(about.hand, pushes=pushes)))
    with pytest.raises(EditError, match="the tracker or the hand uses it"):
        world.change_bodies(())
    assert "chest_wall" in steps(world, 2).bodies


def test_arm_keeps_its_joints_and_tissue_is_not_a_body():
    world = World(open_world(LUMPECTOMY))
    for name, problem in (("tumor", "set_tumor alone"), ("cautery", "an arm moves it")):
        with pytest.raises(EditError, match=problem):
            world.move_bodies({name: at(name, 0)})
    before = steps(world, 20)
    body = cube("obstacle", at("obstacle", 205, 150, 80))
    after = world.change_bodies((*world.description.bodies, body))
    np.testing.assert_array_equal(before.arms["arm"].positions, after.arms["arm"].positions)
    tumor, kept = before.bodies["tumor"].matrix, after.bodies["tumor"].matrix
    np.testing.assert_allclose(tumor, kept, atol=1e-12)
