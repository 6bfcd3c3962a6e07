"""SlicerROS2's names of parameters, services, tf and robots, against a process with rclpy alone."""

import time
from types import SimpleNamespace

import pytest
import vtk

from app.bridge.calls import service_client
from tests.slicer_module.ros2_values import shifted, x_mm
from tests.waiting import DEADLINE_S

pytestmark = pytest.mark.slow


def test_parameters_of_every_type(logic, node, peer, spin_until):
    parameters = logic.AddNewNodeByClass("vtkMRMLROS2ParameterNode")
    assert parameters.AddToROS2Node(node.GetID(), "/peer") is True
    for name in ("flag", "count", "gain", "text", "flags", "counts", "gains", "texts"):
        assert parameters.AddParameter(name) is True
    spin_until(lambda: all(map(parameters.ParameterSet, parameters.GetMonitoredParameters())))
    for name, get, expected in [
        ("flag", parameters.GetParameterAsBool, True),
        ("count", parameters.GetParameterAsInteger, 7),
        ("gain", parameters.GetParameterAsDouble, 1.5),
        ("text", parameters.GetParameterAsString, "ü"),
        ("flags", parameters.GetParameterAsVectorOfBools, (True, False)),
        ("counts", parameters.GetParameterAsVectorOfIntegers, (1, -2, 3)),
        ("gains", parameters.GetParameterAsVectorOfDoubles, (0.5, 2.5)),
        ("texts", parameters.GetParameterAsVectorOfStrings, ("a", "b")),
    ]:
        assert get(name) == expected
        output = vtk.reference(expected)
        assert get(name, output) is True
        assert output.get() == expected
        assert get("missing", output) is False
        assert parameters.PrintParameter(name) == str(expected)
    kind = vtk.reference("")
    assert parameters.GetParameterType("gains", kind) is True
    assert kind.get() == parameters.GetParameterType("gains") == "double_array"


def test_new_client_pauses_only_until_its_server_is_known(logic, node, peer, monkeypatch):
    records = []

    def pause(seconds):
        records.append("pause")
        time.sleep(seconds)

    monkeypatch.setattr(service_client, "time", SimpleNamespace(**vars(time) | {"sleep": pause}))
    for value in (True, False, True):
        client = node.CreateAndAddServiceClientNode("SetBool", "/peer/echo")
        called = client._client._client
        ready, send = called.service_is_ready, called.call_async

        def is_ready(ready=ready):
            found = ready()
            records.append("ready" if found else "not ready")
            return found

        def call(request, send=send):
            records.append("sent")
            return send(request)

        monkeypatch.setattr(called, "service_is_ready", is_ready)
        monkeypatch.setattr(called, "call_async", call)
        records.clear()
        assert client.SendAsyncRequest({"data": value}) == 1
        assert logic.WaitForServiceResponse(client, DEADLINE_S), client.GetLastError()
        assert client.GetLastResponse().GetSuccess() is value
        del records[records.index("sent") + 1 :]  # what follows waits for the reply
        assert records[-2:] == ["ready", "sent"]
        assert records[:-2] == ["not ready", "pause"] * (len(records) // 2 - 1)
        assert node.RemoveAndDeleteServiceClientNode("/peer/echo")


def test_lookup_and_broadcaster_added_by_their_own_frames(logic, node, peer, spin_until):
    broadcaster = logic.AddNewNodeByClass("vtkMRMLROS2Tf2BroadcasterNode")
    lookup = logic.AddNewNodeByClass("vtkMRMLROS2Tf2LookupNode")
    for each, child in ((broadcaster, "sent"), (lookup, "seen")):
        assert each.IsParentAndChildSet() is False
        assert each.AddToROS2Node(node.GetID()) is False
        assert (each.SetParentID("judged"), each.SetChildID(child)) == (True, True)
        assert each.SetChildID("no frame") is False
        assert (each.GetParentID(), each.GetChildID()) == ("judged", child)
        assert each.IsParentAndChildSet() is True
        assert each.AddToROS2Node(node.GetID()) is True
        assert each.IsAddedToROS2Node() is True
        assert each.SetParentID("wall") is False  # it is added
    assert lookup.GetName() == "ros2:tf2lookup:judgedToseen"
    assert node.GetTf2LookupNodeByParentChild("judged", "seen") is lookup
    assert node.GetTf2BroadcasterNodeByID(broadcaster.GetID()) is broadcaster
    assert node.GetTf2LookupNodeByID(lookup.GetID()) is lookup
    peer("listen", topic="/tf", type="tf2_msgs/msg/TFMessage")
    sent = shifted(66.0)
    spin_until(lambda: broadcaster.Broadcast(sent) and peer("has_edge", child="sent", x=0.066))
    different = []
    for x in (0.1, 0.2):

        def arrived(x=x):
            peer("send_tf", edges=[["judged", "seen", [x, 0.0, 0.0]]])
            return x_mm(lookup) == pytest.approx(1000 * x)

        spin_until(arrived)
        stamp = divmod(lookup.GetStampNanoseconds(), 10**9)
        different += [lookup.IsDifferentFromLast(*stamp), lookup.IsDifferentFromLast(*stamp)]
    assert different == [True, False, True, False]
    assert node.RemoveAndDeleteTf2LookupNode(lookup.GetID())
    assert node.RemoveAndDeleteTf2BroadcasterNode(broadcaster.GetID())


@pytest.fixture
def robot(node, describe, spin_until):
    """A robot whose description is a parameter of the peer."""
    made = node.CreateAndAddRobotNode("judged", "/robot_state_publisher", tfPrefix="left")
    spin_until(made.GetLinkNames)
    return made


def test_robot_described_by_the_peer(node, robot, spin_until):
    parameters = node.CreateAndAddParameterNode("/robot_state_publisher")
    parameters.AddParameter("robot_description")
    robot.ObserveParameterNode(parameters)
    assert robot.GetNodeReference("parameter") is parameters
    spin_until(lambda: parameters.ParameterSet("robot_description"))
    assert robot.SetupKDLIKWithLimits() is True
    assert robot.GetJointVelocityLimits() == (1.0,)
    pose = vtk.vtkMatrix4x4()
    assert robot.ComputeKDLFK((0.5,), pose) is pose
    assert float(robot.FindKDLIK(pose, (0.0,))) == pytest.approx(0.5)
    pose.SetElement(2, 3, 900.0)
    assert robot.FindKDLIK(pose) == ""


def test_inverse_kinematics_of_moveit(robot, peer, caplog, monkeypatch):
    pytest.importorskip("moveit_msgs", reason="pip install ./interfaces_extra")
    name = "/judged/compute_ik"  # another test's server has the real name
    monkeypatch.setattr("ROS2Lib.robot_kinematics.SERVICE", name)
    pose = shifted(300.0)
    assert robot.ComputeMoveItIK(pose) == ()
    assert "call SetupIKMoveIt first" in caplog.text
    joints = {"name": ["other", "turn"], "position": [9.0, 0.25]}
    reply = {"solution": {"joint_state": joints}, "error_code": {"val": 1}}
    peer("serve", name=name, type="moveit_msgs/srv/GetPositionIK", reply=reply)
    assert robot.SetupIKMoveIt("") is False
    assert robot.SetupIKMoveIt("arm") is True
    assert robot.setupIKmoveit("arm") is True
    assert robot.ComputeMoveItIK(pose, "tip", (0.5,), 2.5, True) == (0.25,)
    assert robot.FindIKmoveit(pose, "tip", (0.5,)) == "0.25"
    asked = peer("requests", name=name)[0]["ik_request"]
    assert (asked["group_name"], asked["ik_link_name"]) == ("arm", "tip")
    assert asked["avoid_collisions"] is True
    assert asked["timeout"] == {"sec": 2, "nanosec": 500_000_000}
    assert asked["pose_stamped"]["header"]["frame_id"] == "left/base"
    assert asked["pose_stamped"]["pose"]["position"] == {"x": 0.3, "y": 0.0, "z": 0.0}
    assert asked["robot_state"]["joint_state"]["name"] == ["turn"]
    assert asked["robot_state"]["joint_state"]["position"] == [0.5]
    assert robot.ComputeMoveItIK(pose, "tip", (0.5, 0.5)) == ()
    assert "there are 2 joint values; expected 1" in caplog.text
    assert robot.ComputeMoveItIK(pose, timeout=0.0) == ()
    assert "timeout is 0.0 s; expected more than 0" in caplog.text
