"""MoveIt's kinematics services and collision objects, exchanged with a process with rclpy alone."""

import json
from pathlib import Path

import numpy as np
import pytest
import vtk

from app.bridge.convert import ConversionError, message_type, to_plain
from app.bridge.convert.array_messages import collision_object, mesh_message
from app.geometry import MarginGuardError, Transform
from tests.slicer_module.ros2_values import matrix, shifted, translation
from tests.waiting import DEADLINE_S

pytestmark = pytest.mark.slow

moveit = pytest.importorskip("moveit_msgs", reason="pip install ./interfaces_extra")

HASHES = {
    "moveit_msgs/msg/AttachedCollisionObject": "7fdfe7951a33a857f20fc42c9ed410a3",
    "moveit_msgs/msg/BoundingVolume": "00bb0df2edac637497dedf1778d8f217",
    "moveit_msgs/msg/CollisionObject": "74b0acd6d56be032bf4f764b2c2633f5",
    "moveit_msgs/msg/Constraints": "71718200459ae8fecdc4f2c9631215f7",
    "moveit_msgs/msg/JointConstraint": "4996641a8e12f5b7fde07f1cec149032",
    "moveit_msgs/msg/MoveItErrorCodes": "dcda8a9950cf6dd6ac221c2c0d2509f5",
    "moveit_msgs/msg/OrientationConstraint": "7a1917ac47886eb1fc170317952198b2",
    "moveit_msgs/msg/PositionConstraint": "3758504dabfe337a1a660b29917e3405",
    "moveit_msgs/msg/RobotState": "7c516dc15713e545cb2836c5ca745fbd",
    "moveit_msgs/msg/RobotTrajectory": "af1dc87fb94d13e5f233e9c210d2662f",
    "moveit_msgs/msg/VisibilityConstraint": "2b479935307de421623221520ee5d9ff",
    "object_recognition_msgs/msg/ObjectType": "5eb3ee3976403366d7c50d7dbee8bec9",
}
"""First half of the type hash of each message in a MoveIt of ROS 2 Jazzy that colcon built."""

IDENTITY = {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}
COLLISION = "moveit_msgs/msg/CollisionObject"


@pytest.fixture
def client_of(node, peer):
    """``client_of(kind, name, reply)``: a client of a service that the peer serves."""

    def create(kind, name, reply):
        peer("serve", name=name, type=f"moveit_msgs/srv/{kind}", reply=reply)
        return node.CreateAndAddServiceClientNode(f"vtkMRMLROS2ServiceClient{kind}Node", name)

    return create


@pytest.fixture
def model(logic):
    """A tetrahedron of 20 mm, and a transform above it."""
    points, cells = vtk.vtkPoints(), vtk.vtkCellArray()
    for corner in [(0, 0, 0), (20, 0, 0), (0, 20, 0), (0, 0, 20)]:
        points.InsertNextPoint(corner)
    for face in [(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)]:
        cells.InsertNextCell(3, face)
    surface = vtk.vtkPolyData()
    surface.SetPoints(points)
    surface.SetPolys(cells)
    made = logic.scene.AddNewNodeByClass("vtkMRMLModelNode", "chest wall")
    made.SetAndObservePolyData(surface)
    parent = logic.scene.AddNewNodeByClass("vtkMRMLLinearTransformNode")
    made.SetAndObserveTransformNodeID(parent.GetID())
    return made


@pytest.fixture
def publisher(node, hear, request):
    topic = f"/{request.node.name}"  # the peer's subscription stays after the test
    made = node.CreateAndAddPublisherNode("CollisionObject", topic)
    made.SetFrameId("world")
    hear(made)
    return made


def test_definitions_have_the_hashes_of_moveit():
    module = Path(moveit.__file__)
    shares = [folder / "share" for folder in module.parents]
    share = next(each for each in shares if (each / "moveit_msgs" / "msg").is_dir())
    for name, begin in HASHES.items():
        entries = json.loads((share / f"{name}.json").read_text())["type_hashes"]
        (found,) = [each["hash_string"] for each in entries if each["type_name"] == name]
        assert found.startswith(f"RIHS01_{begin}"), name


def test_forward_kinematics(logic, client_of, peer):
    pose = {"position": {"x": 0.1, "y": 0.2, "z": 0.3}, "orientation": IDENTITY}
    client = client_of(
        "GetPositionFK",
        "/compute_fk",
        {
            "pose_stamped": [{"header": {"frame_id": "base"}, "pose": pose}],
            "fk_link_names": ["tool0"],
            "error_code": {"val": 1},
        },
    )
    request = client.CreateBlankRequest()
    assert request.GetClassName() == "vtkMoveitMsgsGetPositionFKRequest"
    request.GetHeader().SetFrameId("base")
    request.SetFkLinkNames(("tool0",))
    request.GetRobotState().GetJointState().SetName(("shoulder", "elbow"))
    request.GetRobotState().GetJointState().SetPosition((0.5, -1.25))
    assert client.SendAsyncRequest(request) == 1
    assert logic.WaitForServiceResponse(client, DEADLINE_S), client.GetLastError()
    (sent,) = peer("requests", name="/compute_fk")
    assert (sent["header"]["frame_id"], sent["fk_link_names"]) == ("base", ["tool0"])
    assert sent["robot_state"]["joint_state"]["position"] == [0.5, -1.25]
    response = client.GetLastResponse()
    assert response.GetErrorCode().GetVal() == response.GetErrorCode().SUCCESS == 1
    assert response.GetFkLinkNames() == ("tool0",)
    (stamped,) = response.GetPoseStamped()
    assert translation(stamped.GetPose()) == pytest.approx([100.0, 200.0, 300.0])


def test_inverse_kinematics(logic, client_of, peer):
    joints = {"name": ["shoulder", "elbow"], "position": [0.25, 1.5]}
    client = client_of(
        "GetPositionIK",
        "/compute_ik",
        {"solution": {"joint_state": joints}, "error_code": {"val": -31, "message": "far"}},
    )
    request = client.CreateBlankRequest()
    asked = request.GetIkRequest()
    asked.SetGroupName("arm")
    asked.SetAvoidCollisions(True)
    asked.GetPoseStamped().GetHeader().SetFrameId("base")
    asked.GetPoseStamped().SetPose(shifted(100.0, 0.0, -50.0))
    asked.GetTimeout().SetNanosec(50_000_000)
    client.SendAsyncRequest(request)
    assert logic.WaitForServiceResponse(client, DEADLINE_S), client.GetLastError()
    sent = peer("requests", name="/compute_ik")[0]["ik_request"]
    assert (sent["group_name"], sent["avoid_collisions"]) == ("arm", True)
    assert sent["pose_stamped"]["pose"]["position"] == {"x": 0.1, "y": 0.0, "z": -0.05}
    assert sent["timeout"] == {"sec": 0, "nanosec": 50_000_000}
    response = client.GetLastResponse()
    assert response.GetErrorCode().GetVal() == response.GetErrorCode().NO_IK_SOLUTION
    assert response.GetErrorCode().GetMessage() == "far"
    assert response.GetSolution().GetJointState().GetPosition() == (0.25, 1.5)


def test_cartesian_path_has_lengths_in_mm(logic, client_of, peer):
    points = [{"positions": [0.0, 0.5]}, {"positions": [0.25, 0.75]}]
    trajectory = {"joint_names": ["shoulder", "elbow"], "points": points}
    client = client_of(
        "GetCartesianPath",
        "/compute_cartesian_path",
        {"solution": {"joint_trajectory": trajectory}, "fraction": 0.5, "error_code": {"val": 1}},
    )
    request = client.CreateBlankRequest()
    request.SetGroupName("arm")
    request.SetWaypoints((shifted(0.0, 0.0, 100.0), shifted(0.0, 25.0, 100.0)))
    request.SetMaxStep(5.0)
    request.SetJumpThreshold(2.5)
    request.SetMaxCartesianSpeed(20.0)
    client.SendAsyncRequest(request)
    assert logic.WaitForServiceResponse(client, DEADLINE_S), client.GetLastError()
    (sent,) = peer("requests", name="/compute_cartesian_path")
    assert [each["position"]["y"] for each in sent["waypoints"]] == [0.0, 0.025]
    assert (sent["max_step"], sent["max_cartesian_speed"]) == (0.005, 0.02)
    assert sent["jump_threshold"] == 2.5
    response = client.GetLastResponse()
    assert response.GetFraction() == 0.5
    path = response.GetSolution().GetJointTrajectory()
    assert [point.GetPositions() for point in path.GetPoints()] == [(0.0, 0.5), (0.25, 0.75)]


def test_model_is_published_in_metres_at_its_pose(publisher, peer, model):
    assert publisher.GetClassName() == "vtkMRMLROS2PublisherCollisionObjectNode"
    assert publisher.GetROSType() == COLLISION
    turned = matrix([[0.0, -1.0, 0.0, 100.0], [1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, -30.0]])
    model.GetParentTransformNode().SetMatrixTransformToParent(turned)
    assert publisher.Publish(model) == 1
    (received,) = peer("take", topic=publisher.GetTopic())
    assert (received["id"], received["header"]["frame_id"]) == ("chest wall", "world")
    assert received["header"]["stamp"]["sec"] > 0
    assert received["operation"] == 0
    assert received["pose"]["position"] == pytest.approx({"x": 0.1, "y": 0.0, "z": -0.03})
    half = np.sqrt(0.5)
    assert received["pose"]["orientation"] == pytest.approx(
        {"x": 0.0, "y": 0.0, "z": half, "w": half}
    )
    (mesh,) = received["meshes"]
    assert [list(each.values()) for each in mesh["vertices"]] == [
        [0.0, 0.0, 0.0],
        [0.02, 0.0, 0.0],
        [0.0, 0.02, 0.0],
        [0.0, 0.0, 0.02],
    ]
    assert [each["vertex_indices"] for each in mesh["triangles"]] == [
        [0, 2, 1],
        [0, 1, 3],
        [0, 3, 2],
        [1, 2, 3],
    ]
    (pose,) = received["mesh_poses"]
    assert pose["orientation"] == IDENTITY


def test_mirrored_model_stays_the_right_way_out(publisher, peer, model):
    mirror = matrix([[-2.0, 0.0, 0.0, 0.0], [0.0, 2.0, 0.0, 0.0], [0.0, 0.0, 2.0, 10.0]])
    model.GetParentTransformNode().SetMatrixTransformToParent(mirror)
    publisher.Publish(model)
    (received,) = peer("take", topic=publisher.GetTopic())
    assert received["pose"]["position"] == {"x": 0.0, "y": 0.0, "z": 0.0}
    (mesh,) = received["meshes"]
    vertices = np.array([list(each.values()) for each in mesh["vertices"]])
    corners = vertices[[each["vertex_indices"] for each in mesh["triangles"]]]
    volume = np.linalg.det(corners - [0.0, 0.0, 0.01]).sum() / 6.0
    assert volume == pytest.approx(8 * 0.02**3 / 6.0)


def test_source_node_is_published_and_removed(publisher, peer, model):
    with pytest.raises(MarginGuardError, match="no model is given"):
        publisher.Publish()
    publisher.SetSourceNodeID(model.GetID())
    assert (publisher.GetSourceNodeID(), publisher.GetSourceNode()) == (model.GetID(), model)
    assert publisher.Publish() == 1
    assert publisher.PublishRemove() == 1
    added, removed = peer("take", topic=publisher.GetTopic(), count=2)
    assert (added["id"], added["operation"]) == ("chest wall", 0)
    assert (removed["id"], removed["operation"], removed["meshes"]) == ("chest wall", 1, [])
    assert publisher.GetNumberOfMessagesSent() == 2
    publisher.SetSourceNodeID(None)
    assert publisher.GetSourceNode() is None


def test_source_node_of_a_saved_scene_is_published_again(make_api, tmp_path):
    path = tmp_path / "scene.mrml"
    saved, again = make_api(), make_api()
    model = saved.scene.AddNewNodeByClass("vtkMRMLModelNode", "rib")
    publisher = saved.GetDefaultROS2Node().CreateAndAddPublisherNode("CollisionObject", "/saved")
    publisher.SetFrameId("world")
    publisher.SetSourceNodeID(model.GetID())
    saved.scene.SetURL(str(path))
    assert saved.scene.Commit()
    saved.Close()
    again.scene.SetURL(str(path))
    assert again.scene.Import()
    found = again.GetDefaultROS2Node().GetPublisherNodeByTopic("/saved")
    assert found.GetClassName() == "vtkMRMLROS2PublisherCollisionObjectNode"
    assert (found.GetFrameId(), found.GetSourceNode().GetName()) == ("world", "rib")


def test_message_is_filled_in_by_its_accessors(publisher, peer):
    message = publisher.GetBlankMessage()
    assert message.GetClassName() == "vtkMoveitMsgsCollisionObject"
    message.SetId("table")
    message.SetOperation(message.MOVE[0])
    message.SetPose(shifted(0.0, 0.0, -500.0))
    assert publisher.Publish(message) == 1
    (received,) = peer("take", topic=publisher.GetTopic())
    assert (received["id"], received["operation"]) == ("table", 3)
    assert received["pose"]["position"]["z"] == -0.5


def test_models_without_a_surface_are_refused(logic, publisher, model):
    empty = logic.scene.AddNewNodeByClass("vtkMRMLModelNode", "empty")
    with pytest.raises(MarginGuardError, match="empty has no surface; expected"):
        publisher.Publish(empty)
    with pytest.raises(MarginGuardError, match="expected a vtkMRMLModelNode"):
        publisher.PublishRemove("chest wall")
    bent = logic.scene.AddNewNodeByClass("vtkMRMLBSplineTransformNode", "bent")
    model.SetAndObserveTransformNodeID(bent.GetID())
    with pytest.raises(MarginGuardError, match="non-linear transform bent; expected linear"):
        publisher.Publish(model)
    assert publisher.GetNumberOfMessagesSent() == 0


def test_subscriber_receives_collision_objects(node, peer, spin_until):
    subscriber = node.CreateAndAddSubscriberNode("CollisionObject", "/monitored")
    vertices = [{"x": 0.001, "y": 0.0, "z": 0.0}]
    sent = {"id": "cup", "meshes": [{"vertices": vertices}], "mesh_poses": [{}]}
    peer("publish", topic="/monitored", type=COLLISION, messages=[sent])
    spin_until(lambda: subscriber.GetNumberOfMessages() == 1)
    message = subscriber.GetLastMessage()
    assert message.GetId() == "cup"
    assert message.GetMeshes()[0].GetVertices()[0].GetX() == pytest.approx(1.0)


def test_invalid_meshes_are_refused():
    corner = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]
    for vertices, triangles, problem in [
        (corner, np.empty((0, 3)), "no triangles"),
        ([[0.0, 0.0, np.nan], *corner], [[0, 1, 2]], "vertex 0 .* expected finite"),
        (corner, [[0, 1, 3]], "vertices 0 to 3; expected 0 to 2"),
        (corner, [[0, 1]], r"expected \(n, 3\) and \(m, 3\)"),
    ]:
        with pytest.raises(ConversionError, match=problem):
            mesh_message(vertices, triangles)
    pose = Transform.identity(target="world", source="model")
    with pytest.raises(ConversionError, match="no identifier"):
        collision_object("", corner, [[0, 1, 2]], pose)


def test_lengths_of_constraints_are_scaled():
    constraint = message_type("moveit_msgs/msg/PositionConstraint")()
    constraint.target_point_offset.z = 0.01
    assert to_plain(constraint)["target_point_offset"]["z"] == 10.0
