"""Robots of the ROS2 module by other sources than a parameter and tf, against an rclpy process."""

import numpy as np
import pytest

from app.scene.convert import world_matrix, world_points
from tests.slicer_module.ros2_values import URDF

pytestmark = pytest.mark.slow

JOINTS = {"topic": "/arm/joint_states", "type": "sensor_msgs/msg/JointState"}


@pytest.fixture
def add(node):
    """``add(name, ...)``: a robot of the default node."""
    return lambda name, **arguments: node.CreateAndAddRobotNode(
        **{"parameterNodeName": "", "robotName": name, **arguments}
    )


@pytest.fixture
def path(tmp_path):
    """A file with `URDF`."""
    (tmp_path / "arm.urdf").write_text(URDF)
    return str(tmp_path / "arm.urdf")


def publish_joints(node, peer, position):
    stamp = dict(zip(("sec", "nanosec"), divmod(node.now_ns(), 10**9), strict=True))
    message = {"header": {"stamp": stamp}, "name": ["turn"], "position": [position]}
    peer("publish", **JOINTS, messages=[message])


def test_robot_of_a_file_follows_joint_states(logic, node, peer, spin_until, add, path):
    before = logic.scene.GetNumberOfNodes()
    robot = add("arm", parameterName=path, source="file", jointStates="/arm/joint_states")
    spin_until(robot.GetLinkNames)
    assert robot.GetLinkNames() == ("base", "wrist", "tip")
    assert robot.IsStale()
    assert robot.GetProblem() == "joints without a position: turn"
    assert robot.GetNumberOfNodeReferences("lookup") == 0

    def turned():
        publish_joints(node, peer, np.pi / 2)
        return not robot.IsStale()

    spin_until(turned)
    tip = robot.link_nodes()["tip"]
    assert np.allclose(world_matrix(tip)[:3, 3], [0.0, 300.0, 100.0])
    model = logic.scene.GetFirstNodeByName("tip_model")
    assert np.allclose(world_points(model).mean(axis=0), [0.0, 300.0, 150.0])
    assert model.GetDisplayNode().GetScalarVisibility()
    assert robot.CreateGoalStateRobot(robot)
    spin_until(robot.IsStale)  # no further message
    assert "old" in robot.GetProblem()
    assert node.RemoveAndDeleteRobotNode("arm")
    assert logic.scene.GetNumberOfNodes() == before
    peer("wait_until", call={"do": "endpoints", "topic": "/arm/joint_states"}, value=[1, 0])


def test_joint_robot_stands_in_a_fixed_frame_of_tf(node, peer, spin_until, add, path):
    robot = add(
        "arm",
        parameterName=path,
        source="file",
        jointStates="/arm/joint_states",
        fixedFrame="world",
    )
    spin_until(robot.GetLinkNames)

    def placed():
        peer("send_tf", edges=[["world", "base", [1.0, 0.0, 0.0]]])
        publish_joints(node, peer, 0.0)
        return not robot.IsStale()

    spin_until(placed)
    assert np.allclose(world_matrix(robot.link_nodes()["tip"])[:3, 3], [1300.0, 0.0, 100.0])


def test_robot_of_a_topic_and_of_a_file_beside_each_other(node, peer, spin_until, add, path):
    add("left", parameterName=path, source="file", tfPrefix="left")
    robot = add("right", parameterName="/right/description", source="topic", tfPrefix="right")
    assert robot.GetProblem() == "no description yet"
    peer("publish_latched", topic="/right/description", type="std_msgs/msg/String", data=URDF)
    spin_until(robot.GetLinkNames)
    spin_until(node.GetRobotNodeByName("left").GetLinkNames)
    assert node.GetTf2LookupNodeByParentChild("left/wrist", "left/tip") is not None
    assert node.GetTf2LookupNodeByParentChild("right/wrist", "right/tip") is not None


def test_mesh_map_of_ambf_makes_a_body_per_mesh(describe, spin_until, add):
    # A parameter of the peer process; AMBF itself cannot be installed here.
    describe("body:no_mesh.stl;")
    robot = add(
        "bodies",
        parameterNodeName="/robot_state_publisher",
        parameterName="robot_description",
        source="mesh map",
    )
    spin_until(lambda: "no_mesh.stl" in robot.GetProblem())
    assert robot.GetProblem() == "mesh 'no_mesh.stl' of body 'body' not found"


def test_invalid_source_is_reported(node, add, caplog, tmp_path, spin_until):
    assert add("x", source="file", parameterName="") is None
    assert "file name is empty; expected a name" in caplog.text
    assert add("x", source="cloud", parameterName="y") is None
    assert "expected one of parameter, topic, file, mesh map" in caplog.text
    robot = add("x", source="file", parameterName=str(tmp_path / "missing.urdf"))
    spin_until(lambda: "missing.urdf" in robot.GetProblem())
    assert robot.GetLinkNames() == ()
