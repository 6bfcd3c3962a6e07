"""Robots of the ROS2 module: description from a parameter of an rclpy node, poses from tf."""

import numpy as np
import pytest

from app.robot import robot_from_text
from app.scene import SceneError
from app.scene.convert import world_matrix, world_points
from tests.slicer_module.ros2_values import URDF, shifted, x_mm

pytestmark = pytest.mark.slow

WHERE = ("/robot_state_publisher", "robot_description")
POSES = [["base", "wrist", [0.0, 0.0, 0.2]], ["wrist", "tip", [0.4, 0.0, 0.0]]]
PLACED_MM = np.array([[390, -10, 200], [410, 10, 300]])
"""Corners of the model of the tip at `POSES`."""


@pytest.fixture
def robots(logic):
    return logic.AddRobot


def names(scene):
    return sorted(scene.GetNthNode(n).GetName() for n in range(scene.GetNumberOfNodes()))


def corners(scene):
    points = world_points(scene.GetFirstNodeByName("tip_model"))
    return np.array([points.min(axis=0), points.max(axis=0)])


def is_coloured(scene, model):
    return bool(scene.GetFirstNodeByName(model).GetDisplayNode().GetScalarVisibility())


def test_robot_from_a_parameter_is_built_posed_and_coloured(
    logic, node, send_tf_until, spin_until, describe, robots
):
    scene = logic.scene
    robot = robots("robot1", *WHERE)
    assert (robot.GetName(), robot.GetRobotName()) == ("ros2:robot:robot1", "robot1")
    assert node.GetRobotNodeByName("robot1") is robot
    assert robot.IsStale()
    spin_until(robot.GetLinkNames)
    assert robot.GetLinkNames() == ("base", "wrist", "tip")
    # Without tf it is displayed in grey at its zero pose, and reports the reason.
    assert np.allclose(
        world_matrix(scene.GetFirstNodeByName("ros2:tf2lookup:wristTotip"))[:3, 3], [300, 0, 100]
    )
    assert not is_coloured(scene, "tip_model")
    assert scene.GetFirstNodeByName("tip_model").GetDisplayNode().GetColor() == (0.5, 0.5, 0.5)
    assert "missing" in robot.GetProblem()
    tip = node.GetTf2LookupNodeByParentChild("wrist", "tip")
    send_tf_until(POSES, lambda: not robot.IsStale() and robot.GetProblem() == "")
    assert tip.GetName() == "ros2:tf2lookup:wristTotip"
    assert tip.GetParentTransformNode().GetName() == "ros2:tf2lookup:baseTowrist"
    assert np.allclose(world_matrix(tip)[:3, 3], [400.0, 0.0, 200.0])
    assert np.allclose(corners(scene), PLACED_MM)
    assert is_coloured(scene, "tip_model")
    assert scene.GetFirstNodeByName("wrist_model") is None
    assert robot.GetNodeReference("model").GetName() == "base_model"
    assert robot.GetNumberOfNodeReferences("lookup") == 3
    # Without further messages it turns grey.
    events = []
    robot.AddObserver("ModifiedEvent", lambda *_: events.append(robot.IsStale()))
    spin_until(robot.IsStale)
    assert events == [True]
    assert not is_coloured(scene, "tip_model")
    assert "stale" in robot.GetProblem()


class ListenerDouble:
    """TEST DOUBLE: gives the description at once. Twenty over DDS take ten seconds."""

    problem = ""

    def __init__(self, ros, settings, source, changed):
        changed(robot_from_text(URDF))

    def close(self):
        pass


def test_robot_is_removed_without_leftovers_repeatedly(
    logic, node, peer, spin_until, describe, robots, monkeypatch
):
    before = names(logic.scene)
    for number in range(20):
        if number == 3:
            monkeypatch.setattr("ROS2Lib.robot.DescriptionListener", ListenerDouble)
        robot = robots("robot1", *WHERE)
        assert logic.AddRobot("robot1", *WHERE) is None
        spin_until(robot.GetLinkNames)
        assert len(names(logic.scene)) > len(before)
        assert logic.RemoveRobot("robot1") is True
        assert logic.RemoveRobot("robot1") is False
        assert names(logic.scene) == before
        assert node.GetTf2LookupNodeByParentChild("wrist", "tip") is None
    assert logic.RemoveRobot("never") is False
    assert robot.GetLinkNames() == ()
    assert not node.ros._close_callbacks
    peer("wait_until", call={"do": "clients_of", "name": "slicer"}, value=[])


def test_two_robots_with_prefixes_and_a_fixed_frame(
    logic, node, send_tf_until, spin_until, describe, robots
):
    left = robots("left", *WHERE, "world", "left")
    right = robots("right", *WHERE, "world", "right/")
    spin_until(lambda: left.GetLinkNames() and right.GetLinkNames())
    sent = [
        ["world", f"{side}/base", [shift, 0.0, 0.0]]
        for side, shift in (("left", -1.0), ("right", 1.0))
    ]
    sent += [[f"{side}/base", f"{side}/wrist", [0.0, 0.0, 0.1]] for side in ("left", "right")]
    sent += [[f"{side}/wrist", f"{side}/tip", [0.0, 0.0, 0.1]] for side in ("left", "right")]
    send_tf_until(sent, lambda: not left.IsStale() and not right.IsStale())
    centres = []
    for index in range(2):
        found = logic.scene.GetNodesByName("tip_model")
        centres.append(world_points(found.GetItemAsObject(index)).mean(axis=0).round(6).tolist())
    assert sorted(centres) == [[-1000.0, 0.0, 250.0], [1000.0, 0.0, 250.0]]
    assert node.GetTf2LookupNodeByParentChild("world", "left/base") is not None
    assert logic.RemoveRobot("left")
    assert logic.scene.GetNodesByName("tip_model").GetNumberOfItems() == 1


def test_lookup_of_the_user_remains_after_the_robot_is_removed(
    logic, node, spin_until, describe, robots
):
    mine = node.CreateAndAddTf2LookupNode("wrist", "tip")
    robot = robots("robot1", *WHERE)
    spin_until(robot.GetLinkNames)
    assert node.GetTf2LookupNodeByParentChild("wrist", "tip") is mine
    assert logic.RemoveRobot("robot1")
    assert node.GetTf2LookupNodeByParentChild("wrist", "tip") is mine
    assert mine.GetParentTransformNode() is None


def test_static_lookup_of_the_user_keeps_the_pose_of_tf(logic, node, spin_until, describe, robots):
    mine = node.CreateAndAddTf2LookupNode("wrist", "tip")
    node.buffer.insert("wrist", "tip", 0, (70.0, 0, 0, 0, 0, 0, 1), static=True)
    node.Spin()
    robot = robots("robot1", *WHERE)
    spin_until(robot.GetLinkNames)
    assert mine.GetState() == "valid"
    assert x_mm(mine) == 70.0
    assert logic.RemoveRobot("robot1")
    assert node.RemoveAndDeleteTf2LookupNode("wrist", "tip")
    node.buffer.clear()


@pytest.mark.parametrize("removed", ["tip_model", "ros2:tf2lookup:wristTotip"])
def test_robot_with_a_removed_link_is_rebuilt(
    logic, node, send_tf_until, spin_until, describe, robots, removed
):
    scene, before = logic.scene, names(logic.scene)
    robot = robots("robot1", *WHERE)
    spin_until(robot.GetLinkNames)
    whole = [name.rstrip("0123456789") for name in names(scene)]  # display nodes are numbered
    scene.RemoveNode(scene.GetFirstNodeByName(removed))
    send_tf_until(POSES, lambda: not robot.IsStale())
    assert is_coloured(scene, "tip_model")
    assert [name.rstrip("0123456789") for name in names(scene)] == whole
    # Another robot with the same frames shares the lookups of the first until that is removed.
    other = robots("robot2", *WHERE)
    spin_until(other.GetLinkNames)
    assert logic.RemoveRobot("robot1")
    send_tf_until(POSES, lambda: not other.IsStale())
    assert np.allclose(corners(scene), PLACED_MM)
    assert logic.RemoveRobot("robot2")
    assert names(scene) == before


def test_moved_links_are_restored_and_a_hardened_robot_is_rebuilt(
    logic, node, send_tf_until, spin_until, describe, robots
):
    scene = logic.scene
    robot = robots("robot1", *WHERE)
    spin_until(robot.GetLinkNames)
    send_tf_until(POSES, lambda: not robot.IsStale())
    aside = scene.AddNewNodeByClass("vtkMRMLLinearTransformNode", "of_the_user")
    aside.SetMatrixTransformToParent(shifted(7.0))
    for name in ("tip_model", "ros2:tf2lookup:wristTotip"):
        scene.GetFirstNodeByName(name).SetAndObserveTransformNodeID(aside.GetID())
        logic.Spin()
        assert np.allclose(corners(scene), PLACED_MM)
    scene.GetFirstNodeByName("tip_model").HardenTransform()
    logic.Spin()
    assert np.allclose(corners(scene), PLACED_MM)
    # The user may place the whole robot by the parent of its root.
    root = robot.GetNodeReference("lookup")
    root.SetAndObserveTransformNodeID(aside.GetID())
    logic.Spin()
    assert np.allclose(corners(scene) - PLACED_MM, [7, 0, 0])


def test_changed_description_rebuilds_the_robot(logic, spin_until, describe, robots):
    before = names(logic.scene)
    robot = robots("robot1", *WHERE)
    spin_until(robot.GetLinkNames)
    describe(URDF.replace('"tip"', '"tool"'))
    spin_until(lambda: robot.GetLinkNames() == ("base", "wrist", "tool"))
    assert "tip_model" not in names(logic.scene)
    assert "tool_model" in names(logic.scene)
    describe("no robot")
    spin_until(lambda: robot._description.refused)
    assert robot.GetLinkNames() == ("base", "wrist", "tool")
    assert logic.RemoveRobot("robot1")
    assert names(logic.scene) == before


def test_failed_build_leaves_no_partial_robot(
    logic, spin_until, describe, robots, caplog, monkeypatch
):
    def model_double(*_):
        """TEST DOUBLE: no loadable robot makes the real one fail."""
        raise SceneError("no model")

    before = names(logic.scene)
    monkeypatch.setattr("ROS2Lib.robot_links.RobotModel", model_double)
    robot = robots("robot1", *WHERE)
    spin_until(lambda: "ros2:robot:robot1: no model" in caplog.text)
    assert robot.GetLinkNames() == ()
    assert robot.IsStale()
    assert logic.RemoveRobot("robot1")
    assert names(logic.scene) == before


def test_robot_without_description_reports_it(logic, node, robots):
    robot = robots("robot1", "/not_there")
    logic.Spin()
    assert robot.GetProblem() == "no description yet"
    assert robot.IsStale()
    assert node.CreateAndAddRobotNode("robot2", "") is None
    assert node.CreateAndAddRobotNode("", "/x") is None


def test_robot_removed_from_the_scene_removes_its_links(logic, node, spin_until, describe, robots):
    before = names(logic.scene)
    robot = robots("robot1", *WHERE)
    spin_until(robot.GetLinkNames)
    logic.scene.RemoveNode(robot)
    assert names(logic.scene) == before
    assert node.GetRobotNodeByName("robot1") is None
