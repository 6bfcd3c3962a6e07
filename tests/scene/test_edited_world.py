"""Bodies of a simulated world: moved by the physics, and by requests of a user."""

import numpy as np
import pytest
import vtk
from slicer import vtkMRMLScene

from app.geometry import Transform
from app.scene.simulated_bodies import ANSWER_NS, EditedWorld

pytestmark = pytest.mark.slow


class Simulation:
    """Test double of the owner of the bodies: records requests."""

    def __init__(self):
        self.requests, self.refused, self.now_ns = [], [], 0
        self.scene = vtkMRMLScene()
        self.world = EditedWorld(
            self.scene,
            "world",
            lambda poses, stamp: self.requests.append((poses, stamp.ns)),
            self.refused.append,
            clock_ns=lambda: self.now_ns,
        )

    def x(self, body="wall"):
        found = vtk.vtkMatrix4x4()
        self.world.node(body).GetMatrixTransformToParent(found)
        return found.GetElement(0, 3)

    def drag(self, x, body="wall"):
        matrix = vtk.vtkMatrix4x4()
        matrix.SetElement(0, 3, x)
        self.world.node(body).SetMatrixTransformToParent(matrix)


def at(x, name="wall"):
    return Transform("world", name, np.eye(3), np.array([x, 0.0, 0.0]))


@pytest.fixture
def simulation():
    found = Simulation()
    found.world.show([at(1.0), at(2.0, "ball")], 0)
    return found


def test_poses_of_the_physics_are_shown_and_not_sent_back(simulation):
    simulation.world.show([at(5.0), at(6.0, "ball")], 10)
    assert simulation.world.send() == 0
    assert (simulation.x(), simulation.x("ball")) == (5.0, 6.0)
    assert simulation.world.node("wall").GetName() == "WallToWorld"
    assert simulation.world.bodies == {"wall", "ball"}


def test_edit_is_a_request_with_the_time_of_the_edit(simulation):
    simulation.now_ns = 77
    simulation.drag(20.0)
    simulation.drag(30.0)
    simulation.now_ns = 99
    assert simulation.requests == []
    assert simulation.world.send() == 1
    assert simulation.world.send() == 0
    (((pose,), stamp_ns),) = simulation.requests
    assert (pose.target, pose.source, stamp_ns) == ("world", "wall", 77)
    assert pose.translation_mm.tolist() == [30.0, 0.0, 0.0]


def test_moved_body_waits_for_the_answer_and_follows_the_physics_again(simulation):
    simulation.drag(30.0)
    simulation.world.send()
    simulation.world.show([at(1.0), at(9.0, "ball")], 5)  # from before the request
    assert (simulation.x(), simulation.x("ball")) == (30.0, 9.0)
    simulation.world.show([at(30.0), at(9.0, "ball")], 6)
    simulation.world.show([at(29.0), at(9.0, "ball")], 7)
    assert simulation.x() == 29.0
    assert simulation.world.send() == 0


def test_refused_edit_comes_back(simulation):
    simulation.drag(30.0)
    simulation.world.show([at(1.0)], ANSWER_NS)
    assert simulation.x() == 1.0


def test_matrix_that_is_not_rigid_is_no_request(simulation):
    matrix = vtk.vtkMatrix4x4()
    matrix.SetElement(0, 0, 2.0)
    simulation.world.node("wall").SetMatrixTransformToParent(matrix)
    assert simulation.world.send() == 0
    assert len(simulation.refused) == 1


def test_body_that_is_gone_has_no_node(simulation):
    simulation.drag(30.0, "ball")
    simulation.world.show([at(1.0)], 6)
    assert simulation.world.bodies == {"wall"}
    assert simulation.world.node("ball") is None
    assert simulation.world.send() == 0
    assert simulation.scene.GetNumberOfNodesByClass("vtkMRMLLinearTransformNode") == 2


def test_clear_removes_the_nodes(simulation):
    simulation.world.clear()
    assert simulation.scene.GetNumberOfNodesByClass("vtkMRMLLinearTransformNode") == 0
