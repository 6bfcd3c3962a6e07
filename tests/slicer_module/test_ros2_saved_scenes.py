"""Scenes saved here or by SlicerROS2: after loading, their nodes are on the ROS graph again."""

import logging

import pytest
from slicer import vtkMRMLScene

from tests.slicer_module.ros2_values import shifted, x_mm
from tests.waiting import DEADLINE_S, wait_until

pytestmark = pytest.mark.slow

OF_SLICER_ROS2 = """<?xml version="1.0" encoding="UTF-8"?>
<MRML version="Slicer4.4.0" userTags="">
 <ROS2Node id="vtkMRMLROS2NodeNode2" name="ros2:node:helper" ROS2NodeName="helper"
  references="publisher:vtkMRMLROS2PublisherPoseNode1;" ></ROS2Node>
 <ROS2PublisherPose id="vtkMRMLROS2PublisherPoseNode1" name="ros2:pub:/tip" topicName="/tip"
  references="node:vtkMRMLROS2NodeNode2;" ></ROS2PublisherPose>
 <ROS2SubscriberString id="vtkMRMLROS2SubscriberStringNode1" name="ros2:sub:/news"
  topicName="/news" references="node:vtkMRMLROS2NodeNode1;" ></ROS2SubscriberString>
 <ROS2ServiceClientSetBoolString id="vtkMRMLROS2ServiceClientSetBoolStringNode1"
  name="ros2:srv:client:/peer/echo" serviceName="/peer/echo"
  references="node:vtkMRMLROS2NodeNode1;" ></ROS2ServiceClientSetBoolString>
 <ROS2Parameter id="vtkMRMLROS2ParameterNode1" name="ros2:param:/robot_state_publisher"
  MRMLNodeName="ros2:param:/robot_state_publisher" MonitoredNodeName="/robot_state_publisher"
  monitoredParameterNames="robot_description" references="node:vtkMRMLROS2NodeNode1;"
  ></ROS2Parameter>
 <ROS2Tf2Broadcaster id="vtkMRMLROS2Tf2BroadcasterNode1" name="ros2:tf2broadcaster:aTob"
  mChildID="b" mParentID="a" references="node:vtkMRMLROS2NodeNode1;" ></ROS2Tf2Broadcaster>
 <ROS2Tf2Lookup id="vtkMRMLROS2Tf2LookupNode1" name="ros2:tf2lookup:worldToleft/base"
  mChildID="left/base" mParentID="world" mModifiedOnLookup="true"
  matrixTransformToParent="1 0 0 7  0 1 0 0  0 0 1 0  0 0 0 1"
  references="node:vtkMRMLROS2NodeNode1;" ></ROS2Tf2Lookup>
 <ROS2Tf2Lookup id="vtkMRMLROS2Tf2LookupNode2" name="ros2:tf2lookup:left/baseToleft/wrist"
  mChildID="left/wrist" mParentID="left/base" mModifiedOnLookup="false"
  matrixTransformToParent="1 0 0 0  0 1 0 0  0 0 1 0  0 0 0 1"
  references="node:vtkMRMLROS2NodeNode1;transform:vtkMRMLROS2Tf2LookupNode1;" ></ROS2Tf2Lookup>
 <LinearTransform id="vtkMRMLLinearTransformNode4" name="mounted"
  matrixTransformToParent="1 0 0 2  0 1 0 0  0 0 1 0  0 0 0 1"
  references="transform:vtkMRMLROS2Tf2LookupNode1;" ></LinearTransform>
 <Model id="vtkMRMLModelNode1" name="base_model_0"
  references="transform:vtkMRMLROS2Tf2LookupNode1;" ></Model>
 <ROS2RobotNode id="vtkMRMLROS2RobotNode1" name="ros2:robot:left" RobotName="left"
  references="node:vtkMRMLROS2NodeNode1;lookup:vtkMRMLROS2Tf2LookupNode1 \
vtkMRMLROS2Tf2LookupNode2;model:vtkMRMLModelNode1;parameter:vtkMRMLROS2ParameterNode1;"
  ></ROS2RobotNode>
</MRML>
"""


@pytest.fixture
def make(make_api):
    """``make()``: logic of the module for a new scene with its default node."""

    def with_node():
        api = make_api()
        api.GetDefaultROS2Node()
        return api

    return with_node


def load(api, path):
    """Load as Slicer does: the present nodes are removed, then the default node is made again."""
    api.scene.SetURL(str(path))
    closed = api.scene.AddObserver(
        vtkMRMLScene.EndCloseEvent, lambda *_: api.GetDefaultROS2Node() and None
    )
    loaded = api.scene.Connect()
    api.scene.RemoveObserver(closed)
    return loaded


def save(api, path):
    api.scene.SetURL(str(path))
    assert api.scene.Commit()
    api.Destroy()


def test_saved_scene_joins_the_graph_again(make, peer, tmp_path):
    api = make()
    node = api.GetDefaultROS2Node()
    other = api.AddNewNodeByClass("vtkMRMLROS2NodeNode")
    other.Create("helper", "station")
    publisher = api.AddNewNodeByClass("vtkMRMLROS2PublisherPointCloudNode")
    publisher.SetQoSDurability(publisher.TransientLocal)
    publisher.SetFrameId("needle")
    assert publisher.AddToROS2Node(other.GetID(), "/cloud")
    node.CreateAndAddSubscriberNode("geometry_msgs/msg/Twist", "/twist")
    node.CreateAndAddServiceClientNode("SetBool", "/peer/echo").SetTimeoutSeconds(9.0)
    parameters = node.CreateAndAddParameterNode("/peer")
    parameters.AddParameter("count")
    lookup = node.CreateAndAddTf2LookupNode("wall", "lamp")
    lookup.SetModifiedOnLookup(False)
    pose = shifted(12.0)
    lookup.SetMatrixTransformToParent(pose)
    below = api.scene.AddNewNodeByClass("vtkMRMLLinearTransformNode", "below")
    below.SetAndObserveTransformNodeID(lookup.GetID())
    broadcaster = node.CreateAndAddTf2BroadcasterNode("wall", "copy")
    broadcaster.ObserveTransformNode(below)
    robot = node.CreateAndAddRobotNode("arm", "/robot_state_publisher", "robot_description")
    wait_until(robot.GetLinkNames, api.Spin)
    removed = node.CreateAndAddPublisherNode("String", "/removed")
    assert removed.RemoveFromROS2Node(node.GetID(), "/removed")
    path = tmp_path / "scene.mrml"
    save(api, path)

    again = make()
    assert load(again, path)
    node = again.GetDefaultROS2Node()
    assert again.scene.GetNumberOfNodesByClass("vtkMRMLROS2NodeNode") == 2
    (other,) = [each for each in again.nodes() if each.GetROS2NodeName() == "helper"]
    assert other.GetROS2NodeNamespace() == "/station"
    publisher = other.GetPublisherNodeByTopic("/cloud")
    assert publisher.GetClassName() == "vtkMRMLROS2PublisherPointCloudNode"
    assert publisher.GetQoSDurability() == publisher.TransientLocal
    assert publisher.GetFrameId() == "needle"
    peer("wait_until", call={"do": "endpoints", "topic": "/cloud"}, value=[1, 0])
    subscriber = node.GetSubscriberNodeByTopic("/twist")
    assert subscriber.GetROSType() == "geometry_msgs/msg/Twist"
    peer("publish", topic="/twist", type="geometry_msgs/msg/Twist", messages=[{}])
    wait_until(subscriber.GetNumberOfMessages, again.Spin)
    client = node.GetServiceClientNodeByService("/peer/echo")
    client.SendAsyncRequest({"data": True})
    assert again.WaitForServiceResponse(client, DEADLINE_S)
    parameters = node.GetParameterNodeByNode("/peer")
    wait_until(lambda: parameters.ParameterSet("count"), again.Spin)
    lookup = node.GetTf2LookupNodeByParentChild("wall", "lamp")
    assert (lookup.GetState(), x_mm(lookup)) == ("missing", 12.0)  # the last pose, not a valid one
    assert lookup.GetModifiedOnLookup() is False
    assert again.scene.GetFirstNodeByName("below").GetParentTransformNode() is lookup
    broadcaster = node.GetTf2BroadcasterNodeByParentChild("wall", "copy")
    again.scene.GetFirstNodeByName("below").SetMatrixTransformToParent(pose)
    assert broadcaster.GetNumberOfBroadcasts() == 0
    robot = node.GetRobotNodeByName("arm")
    wait_until(robot.GetLinkNames, again.Spin)
    assert robot.GetLinkNames() == ("base", "wrist", "tip")
    for name in ("ros2:tf2lookup:wristTotip", "tip_model"):
        assert again.scene.GetNodesByName(name).GetNumberOfItems() == 1
    assert node.RemoveAndDeleteRobotNode("arm")
    assert again.scene.GetFirstNodeByName("ros2:tf2lookup:wristTotip") is None
    assert node.GetPublisherNodeByTopic("/removed") is None


def test_scene_of_slicer_ros2_joins_the_graph(make, peer, tmp_path):
    path = tmp_path / "theirs.mrml"
    path.write_text(OF_SLICER_ROS2)
    api = make()
    assert load(api, path)
    node = api.GetDefaultROS2Node()
    (helper,) = [each for each in api.nodes() if each is not node]
    assert helper.GetName() == "ros2:node:helper"
    peer("wait_until", call={"do": "has_node", "name": "helper"}, value=True)
    publisher = helper.GetPublisherNodeByTopic("/tip")
    assert publisher.GetROSType() == "geometry_msgs/msg/Pose"
    assert helper.GetNodeReference("publisher") is publisher
    subscriber = node.GetSubscriberNodeByTopic("/news")
    peer("publish", topic="/news", type="std_msgs/msg/String", messages=[{"data": "x"}])
    wait_until(subscriber.GetNumberOfMessages, api.Spin)
    client = node.GetServiceClientNodeByService("/peer/echo")
    client.SendAsyncRequest({"data": True})
    assert api.WaitForServiceResponse(client, DEADLINE_S)
    assert node.GetTf2BroadcasterNodeByParentChild("a", "b") is not None
    parameters = node.GetParameterNodeByNode("/robot_state_publisher")
    wait_until(lambda: parameters.ParameterSet("robot_description"), api.Spin)
    base = node.GetTf2LookupNodeByParentChild("world", "left/base")
    assert (base.GetState(), x_mm(base)) == ("missing", 7.0)
    assert api.scene.GetFirstNodeByName("mounted").GetParentTransformNode() is base
    robot = node.GetRobotNodeByName("left")
    wait_until(robot.GetLinkNames, api.Spin)
    assert robot.GetNumberOfNodeReferences("lookup") == 3
    assert robot.GetNodeReference("lookup") is base
    assert node.GetTf2LookupNodeByParentChild("left/wrist", "left/tip") is not None
    assert api.scene.GetFirstNodeByName("base_model_0") is None
    assert api.scene.GetFirstNodeByName("base_model").GetParentTransformNode() is base


def test_scene_added_to_a_scene_keeps_the_present_nodes(make, peer, tmp_path):
    path = tmp_path / "theirs.mrml"
    path.write_text(OF_SLICER_ROS2)
    api = make()
    node = api.GetDefaultROS2Node()
    present = node.CreateAndAddSubscriberNode("String", "/present")
    broadcaster = node.CreateAndAddTf2BroadcasterNode("a", "b")
    api.scene.SetURL(str(path))
    assert api.scene.Import()
    assert node.GetSubscriberNodeByTopic("/present") is present
    assert node.GetTf2BroadcasterNodeByParentChild("a", "b") is broadcaster
    assert node.GetSubscriberNodeByTopic("/news") is not None


def test_saved_values_of_another_form_are_reported(make, tmp_path, caplog):
    api = make()
    node = api.GetDefaultROS2Node()
    for topic in ("/names", "/settings", "/kind", "/count"):
        node.CreateAndAddSubscriberNode("String", topic)
    names = {each.GetTopic(): each for each in node.members}
    names["/names"].SetAttribute("ros2.names", "{")
    names["/settings"].SetAttribute("ros2.settings", '{"depth": "deep"}')
    names["/kind"].SetAttribute("ros2.kind", "Nothing")
    names["/count"].SetAttribute("ros2.names", '["/count", "too many"]')
    path = tmp_path / "scene.mrml"
    save(api, path)
    again = make()
    caplog.set_level(logging.ERROR)
    assert load(again, path)
    node = again.GetDefaultROS2Node()
    assert [each.GetTopic() for each in node.members] == ["/settings"]
    for text in ("ros2:sub:/names: Expecting", "/settings: settings are ignored", "'Nothing'"):
        assert text in caplog.text


def test_too_many_ros_nodes_are_not_created(make, tmp_path, caplog, monkeypatch):
    monkeypatch.setattr("ROS2Lib.scene_loader.MAX_NODES", 3)
    path = tmp_path / "theirs.mrml"
    path.write_text(OF_SLICER_ROS2)
    api = make()
    assert load(api, path)
    assert api.GetDefaultROS2Node().members == ()
    assert "the loaded scene has 9 ROS 2 nodes; expected at most 3" in caplog.text
