"""A simulated world in the scene of the ROS2 module: edits reach the physics, and come back."""

import numpy as np
import pytest
from slicer import vtkMRMLModelNode

from app.bridge import RosNode
from app.bridge.simulation import NODE_NAME
from app.geometry import MarginGuardError
from app.scene.convert import poly_data, world_matrix, world_points
from app.simulation import BodyEntry, WorldDescription
from tests.bridge.simulation.stepped_world import SteppedWorld, at, cube
from tests.slicer_module.ros2_values import shifted
from tests.waiting import wait_until

pytestmark = pytest.mark.slow


def boxes():
    bodies = tuple(
        BodyEntry(name, cube(name), at(name, x), mass)
        for name, x, mass in (("wall", 0.0, None), ("ball", 100.0, 0.1))
    )
    return WorldDescription("boxes", 1, gravity_m_s2=0.0, bodies=bodies)


@pytest.fixture
def physics(node, ros_domain):
    with RosNode(NODE_NAME, domain_id=ros_domain) as ros:
        yield SteppedWorld(ros, boxes())


@pytest.fixture
def shown(node, physics, logic):
    member = node.CreateAndAddSimulatedWorldNode()

    def until(ready):
        def meanwhile():
            physics.step()
            logic.Spin()

        wait_until(ready, meanwhile)

    until(lambda: member.GetBodies() == ["ball", "wall"])
    # The scene can still have the places of the world of the test before.
    for body in ("ball", "wall"):
        until(lambda body=body: x_of(member, body) == pytest.approx(physics.x(body), abs=1e-3))
    until(lambda: member._editor.is_connected() and physics.refusals_are_received())
    return member, until


def x_of(member, body):
    return float(world_matrix(member.GetBodyTransformNode(body))[0, 3])


def test_moved_transform_moves_the_body_and_what_physics_moves_comes_back(shown, physics):
    member, until = shown
    member.GetBodyTransformNode("wall").SetMatrixTransformToParent(shifted(-30.0))
    until(lambda: physics.x("wall") == pytest.approx(-30.0, abs=1e-6))
    physics.world.move_bodies({"ball": at("ball", 140.0)})
    until(lambda: x_of(member, "ball") == pytest.approx(140.0, abs=1e-3))
    assert member.GetProblem() == ""
    assert member.GetNumberOfRequests() == 1


def test_bodies_have_their_surfaces_which_move_with_them(shown, physics, logic):
    member, until = shown
    until(lambda: None not in [member.GetBodyModelNode(name) for name in ("wall", "ball")])
    model = member.GetBodyModelNode("wall")
    member.GetBodyTransformNode("wall").SetMatrixTransformToParent(shifted(-30.0))
    until(lambda: physics.x("wall") == pytest.approx(-30.0, abs=1e-6))
    until(lambda: x_of(member, "wall") == pytest.approx(-30.0, abs=1e-6))
    low, high = world_points(model).min(axis=0), world_points(model).max(axis=0)
    np.testing.assert_allclose([low, high], [[-40, -10, -10], [-20, 10, 10]], atol=1e-4)
    count = logic.scene.GetNumberOfNodes()
    member.RemoveBody("wall")
    until(lambda: member.GetBodyModelNode("wall") is None)
    assert not logic.scene.IsNodePresent(model)
    until(lambda: member.GetBodies() == ["ball"])
    assert logic.scene.GetNumberOfNodes() == count - 3  # with its display and its transform
    assert member.GetBodyModelNode("ball") is not None


def test_refused_move_goes_back_to_where_the_body_is(shown, physics):
    member, until = shown
    member.GetBodyTransformNode("ball").SetMatrixTransformToParent(shifted(5.0))
    until(lambda: "overlaps 'wall'" in member.GetProblem())
    until(lambda: x_of(member, "ball") == pytest.approx(physics.x("ball"), abs=1e-3))
    assert physics.x("ball") == pytest.approx(100.0, abs=1e-3)
    assert "refused" in member.status()


def test_model_becomes_a_body_and_is_removed(shown, physics, logic):
    member, until = shown
    model = vtkMRMLModelNode()
    model.SetAndObservePolyData(poly_data(cube("clip", 200.0)))
    logic.scene.AddNode(model)
    member.AddBody("clip", model)
    until(lambda: "clip" in member.GetBodies())
    assert model.GetParentTransformNode() is member.GetBodyTransformNode("clip")
    member.GetBodyTransformNode("clip").SetMatrixTransformToParent(shifted(50.0))
    until(lambda: physics.x("clip") == pytest.approx(50.0, abs=1e-6))
    member.RemoveBody("clip")
    until(lambda: "clip" not in physics.world.state().bodies)
    until(lambda: member.GetBodies() == ["ball", "wall"])


def test_model_without_a_surface_is_refused(shown, logic):
    member, _ = shown
    model = logic.scene.AddNode(vtkMRMLModelNode())
    with pytest.raises(MarginGuardError, match="has no surface"):
        member.AddBody("clip", model)


def test_removed_member_takes_its_transforms_along(node, shown, logic):
    member, _ = shown
    nodes = [member.GetBodyTransformNode(body) for body in member.GetBodies()]
    assert node.RemoveAndDeleteSimulatedWorldNode()
    assert all(each.GetScene() is None for each in nodes)
    assert node.GetSimulatedWorldNode() is None
