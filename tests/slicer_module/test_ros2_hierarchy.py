"""A hierarchy of transforms on tf, as another node receives it."""

import numpy as np
import pytest

from app.bridge import RosNode, topics
from app.bridge.ros_errors import TfError
from app.bridge.tf import TransformBuffer
from app.bridge.tf_topics import TfListener, tf_message
from app.geometry import Stamp, Transform
from app.scene.scene_nodes import FRAME, mark
from tests.slicer_module.ros2_values import matrix, shifted

pytestmark = pytest.mark.slow


class Other:
    """Another node, which receives tf and may broadcast."""

    def __init__(self, ros):
        self.buffer = TransformBuffer()
        TfListener(ros, self.buffer, clock=False)
        self.tf = ros.publisher(topics.TF)

    def x_mm(self, parent, child):
        """The x of a frame; None while it is not on tf."""
        try:
            return float(self.buffer.lookup(parent, child).transform.translation_mm[0])
        except TfError:
            return None


@pytest.fixture
def other(node, ros_domain):
    with RosNode("other", domain_id=ros_domain) as ros:
        yield Other(ros)


@pytest.fixture
def make(logic):
    """``make(name, x_mm, parent)``: a linear transform node of the user."""

    def create(name, x_mm, parent=None):
        created = logic.scene.AddNewNodeByClass("vtkMRMLLinearTransformNode", name)
        created.SetMatrixTransformToParent(shifted(x_mm))
        if parent is not None:
            created.SetAndObserveTransformNodeID(parent.GetID())
        return created

    return create


@pytest.fixture
def member(node):
    return node.CreateAndAddTf2HierarchyNode("hospital")


def test_all_transforms_below_the_top_are_broadcast_and_follow_an_edit(
    member, other, make, spin_until
):
    top = make("BedToHospital", 100.0)
    middle = make("MastToBed", 20.0, top)
    make("LampToMast", 3.0, middle)
    make("BesideToHospital", 1.0)
    member.ObserveTransformNode(top)
    spin_until(lambda: other.x_mm("hospital", "lamp") == pytest.approx(123.0, abs=1e-6))
    assert member.GetFrames() == ["bed", "lamp", "mast"]
    assert member.GetProblem() == ""
    middle.SetMatrixTransformToParent(shifted(-7.0))
    spin_until(lambda: other.x_mm("hospital", "lamp") == pytest.approx(96.0, abs=1e-6))
    assert other.x_mm("hospital", "beside") is None
    count = member.GetNumberOfBroadcasts()
    spin_until(lambda: member.GetNumberOfBroadcasts() > count)  # repeated without an edit
    member.ObserveTransformNode(None)
    assert member.GetFrames() == []


def test_frame_of_another_node_is_not_broadcast(member, other, make, spin_until):
    top = make("RackToHospital", 100.0)
    make("ShelfToRack", 5.0, top)

    def rival():
        pose = Transform("rack", "shelf", np.eye(3), np.array([50.0, 0.0, 0.0]))
        other.tf.publish(tf_message([(pose, Stamp(member._owner.now_ns()))]))
        return "frame 'shelf' is broadcast by another node" in member.GetProblem()

    member.ObserveTransformNode(top)
    spin_until(rival)
    spin_until(lambda: other.x_mm("hospital", "rack") == pytest.approx(100.0, abs=1e-6))
    assert member.GetFrames() == ["rack"]
    assert other.x_mm("hospital", "shelf") in (None, pytest.approx(150.0, abs=1e-6))


def test_what_the_scene_does_not_own_is_left_out(node, member, other, make, spin_until):
    top = make("RoomToHospital", 100.0)
    ours = make("NeedleToRoom", 1.0, top)
    mark(ours, FRAME)  # as MarginGuard marks the transforms that it sets
    make("NoteToNeedle", 2.0, ours)
    lookup = node.CreateAndAddTf2LookupNode("Room", "Scope")
    lookup.SetAndObserveTransformNodeID(top.GetID())
    scaled = make("ScaledToRoom", 0.0, top)
    scaled.SetMatrixTransformToParent(matrix(np.diag([2.0, 1.0, 1.0])))
    make("BelowToScaled", 4.0, scaled)
    member.ObserveTransformNode(top)
    spin_until(lambda: other.x_mm("hospital", "room") == pytest.approx(100.0, abs=1e-6))
    spin_until(lambda: other.x_mm("needle", "note") == pytest.approx(2.0, abs=1e-6))
    assert member.GetFrames() == ["note", "room"]
    problem = member.GetProblem()
    assert "NeedleToRoom is not set by the scene" in problem
    assert f"{lookup.GetName()} is not set by the scene" in problem
    assert "ScaledToRoom: " in problem
    assert "not sent" in member.status()


def test_second_frame_of_one_name_is_refused(member, other, make, spin_until):
    top = make("WardToHospital", 100.0)
    make("DeskToWard", 1.0, top)
    make("DeskToTable", 2.0, top)
    member.ObserveTransformNode(top)
    spin_until(lambda: "a second frame 'desk'; expected one" in member.GetProblem())
    assert member.GetFrames() == ["desk", "ward"]
