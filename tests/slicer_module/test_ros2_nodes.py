"""ROS nodes of the ROS2 module: creation, search, release of all resources on destruction."""

import gc
import threading

import pytest
from slicer import vtkMRMLScene

from app.geometry import MarginGuardError
from tests.waiting import DEADLINE_S, wait_until

pytestmark = pytest.mark.slow


@pytest.fixture
def api(make_api):
    return make_api()


@pytest.fixture
def scene(api):
    return api.scene


def test_default_node_is_unique_and_found_by_name(api, scene):
    node = api.GetDefaultROS2Node()
    assert api.GetDefaultROS2Node() is node
    assert node.GetName() == "ros2:node:slicer"
    assert node.GetROS2NodeName() == "slicer"
    assert node.GetClassName() == "vtkMRMLROS2NodeNode"
    # The scene returns the same object after Python has dropped its references.
    identifier = node.GetID()
    del node
    gc.collect()
    found = scene.GetFirstNodeByName("ros2:node:slicer")
    assert found is scene.GetNodeByID(identifier)
    assert found.CreateAndAddPublisherNode("String", "/found") is not None


def test_further_nodes_are_created_by_class_or_by_name(api, scene, peer):
    from ROS2Lib.node import vtkMRMLROS2NodeNode

    one = api.AddNewNodeByClass("vtkMRMLROS2NodeNode")
    one.Create("one")
    other = vtkMRMLROS2NodeNode()
    scene.AddNode(other)
    other.Create("other")
    assert [node.GetROS2NodeName() for node in api.nodes()] == ["one", "other"]
    for name in ("one", "other"):
        peer("wait_until", call={"do": "has_node", "name": name}, value=True)
    # Each node may have one publisher per topic.
    assert one.CreateAndAddPublisherNode("String", "/x") is not None
    assert other.CreateAndAddPublisherNode("String", "/x") is not None
    for wrong in ("vtkMRMLModelNode", "vtkMRMLROS2PublisherNode", "ROS2"):
        with pytest.raises(MarginGuardError, match="no class of the ROS2 module"):
            api.AddNewNodeByClass(wrong)


def test_invalid_name_or_state_is_rejected(api):
    from ROS2Lib.node import vtkMRMLROS2NodeNode

    with pytest.raises(MarginGuardError, match="in no scene"):
        vtkMRMLROS2NodeNode().Create("x")
    node = api.AddNewNodeByClass("vtkMRMLROS2NodeNode")
    with pytest.raises(MarginGuardError, match="cannot be started"):
        node.Create("two words")
    assert node.CreateAndAddPublisherNode("String", "/x") is None
    assert node.RemoveAndDeletePublisherNode("/x") is False
    node.Create("fine")
    with pytest.raises(MarginGuardError, match="already created as"):
        node.Create("again")


def members_of_every_kind(node):
    return [
        node.CreateAndAddPublisherNode("String", "/x"),
        node.CreateAndAddSubscriberNode("String", "/x"),
        node.CreateAndAddServiceClientNode("Trigger", "/peer/no_reply"),
        node.CreateAndAddParameterNode("/peer"),
        node.CreateAndAddTf2BroadcasterNode("a", "b"),
        node.CreateAndAddTf2LookupNode("a", "b"),
        node.CreateAndAddRobotNode("robot1", "/robot_state_publisher"),
    ]


@pytest.mark.parametrize("how", ["Destroy", "RemoveNode", "Clear"])
def test_destroy_removes_all_members_and_is_idempotent(api, scene, how, peer):
    scene.Clear()
    before = scene.GetNumberOfNodes()
    threads = set(threading.enumerate())
    node = api.AddNewNodeByClass("vtkMRMLROS2NodeNode")
    node.Create("ending")
    members = members_of_every_kind(node)
    assert all(members)
    members[2].SendAsyncRequest({})
    if how == "Destroy":
        node.Destroy()
    elif how == "RemoveNode":
        scene.RemoveNode(node)
    else:
        scene.Clear()
    assert scene.GetNumberOfNodes() == before
    assert not node.IsCreated()
    assert not any(member.IsAddedToROS2Node() for member in members)
    peer("wait_until", call={"do": "endpoints", "topic": "/x"}, value=[0, 0])
    peer("wait_until", call={"do": "has_node", "name": "ending"}, value=False)
    for _ in range(2):
        node.Destroy()
        node.Spin()
        api.Spin()
    assert node.CreateAndAddPublisherNode("String", "/x") is None
    wait_until(lambda: set(threading.enumerate()) <= threads)
    api.Destroy()
    api.Destroy()


def test_member_removed_from_the_scene_leaves_the_graph(api, scene, peer):
    node = api.GetDefaultROS2Node()
    before = scene.GetNumberOfNodes()
    for member in members_of_every_kind(node):
        scene.RemoveNode(member)
        assert not member.IsAddedToROS2Node()
    assert node.members == ()
    assert scene.GetNumberOfNodes() == before
    peer("wait_until", call={"do": "endpoints", "topic": "/x"}, value=[0, 0])
    api.Spin()


def test_observer_may_destroy_everything_during_its_event(api):
    node = api.GetDefaultROS2Node()
    publisher = node.CreateAndAddPublisherNode("Int", "/end")
    subscribers = [node.CreateAndAddSubscriberNode("Int", "/end")]
    received = []

    def end(caller, _):
        received.append(caller.GetLastMessage())
        node.Destroy()

    subscribers[0].AddObserver("ModifiedEvent", end)
    assert node.ros.wait_for_subscribers(publisher._publisher.topic, 1, DEADLINE_S)
    publisher.Publish(1)
    publisher.Publish(2)
    wait_until(lambda: received, api.Spin)
    assert received == [1]
    assert not node.IsCreated()


@pytest.fixture
def subscriber_and_publish(api):
    """A subscriber, and a function that publishes numbers to it and waits until they are queued."""
    node = api.GetDefaultROS2Node()
    publisher = node.CreateAndAddPublisherNode("Int", "/nested")
    subscriber = node.CreateAndAddSubscriberNode("Int", "/nested")
    assert node.ros.wait_for_subscribers(publisher._publisher.topic, 1, DEADLINE_S)

    def publish(*numbers):
        before = len(subscriber._queue._raws)
        for number in numbers:
            publisher.Publish(number)
        wait_until(lambda: len(subscriber._queue._raws) == before + len(numbers))

    return subscriber, publish


def test_observer_that_spins_receives_messages_in_order(api, subscriber_and_publish):
    subscriber, publish = subscriber_and_publish
    received = []

    def spin_again(caller, _):
        if not received:
            publish(2)  # arrives while the events of 0 and 1 are being invoked
        received.append(caller.GetLastMessage())
        api.Spin()
        received.append(caller.GetLastMessage())

    subscriber.AddObserver("ModifiedEvent", spin_again)
    publish(0, 1)
    api.Spin()
    api.Spin()
    assert received == [0, 0, 1, 1, 2, 2]
    assert subscriber.GetNumberOfMessages() == 3


def test_observer_may_wait_for_the_client_that_invoked_it(api, peer):
    client = api.GetDefaultROS2Node().CreateAndAddServiceClientNode("SetBool", "/peer/echo")
    results = []

    def call_again(caller, _):
        results.append(caller.GetLastResponse().GetSuccess())
        if len(results) < 3:
            caller.SendAsyncRequest({"data": False})
            assert api.WaitForServiceResponse(caller, DEADLINE_S)

    client.AddObserver("ModifiedEvent", call_again)
    client.SendAsyncRequest({"data": True})
    assert api.WaitForServiceResponse(client, DEADLINE_S)
    assert results == [True, False, False]


def test_failing_member_does_not_prevent_the_others_from_spinning(api, monkeypatch, caplog):
    node = api.GetDefaultROS2Node()
    failing = node.CreateAndAddSubscriberNode("Int", "/failing")
    lookup = node.CreateAndAddTf2LookupNode("a", "b")

    def fail_double():
        """TEST DOUBLE of an unexpected error."""
        raise AttributeError("no such thing")

    monkeypatch.setattr(failing, "spin", fail_double)
    api.Spin()
    assert "'a' is unknown" in lookup.GetProblem()
    assert "ros2:sub:/failing failed" in caplog.text


def test_failed_creation_of_the_default_node_leaves_nothing(api, scene, monkeypatch):
    before = scene.GetNumberOfNodes()
    monkeypatch.setattr("ROS2Lib.logic.DEFAULT_NODE", "two words")
    for _ in range(2):
        with pytest.raises(MarginGuardError, match="cannot be started"):
            api.GetDefaultROS2Node()
    assert scene.GetNumberOfNodes() == before


def test_member_belongs_to_one_node_only(api):
    one, other = (api.AddNewNodeByClass("vtkMRMLROS2NodeNode") for _ in range(2))
    one.Create("one")
    other.Create("other")
    publisher = one.CreateAndAddPublisherNode("String", "/x")
    assert publisher.GetNodeReference("node") is one
    assert publisher.AddToROS2Node(other.GetID(), "/y") is False
    assert publisher.AddToROS2Node("missing", "/y") is False
    assert publisher.GetTopic() == "/x"


def test_saved_scene_contains_names_and_topics(api, scene, tmp_path):
    node = api.GetDefaultROS2Node()
    node.CreateAndAddPublisherNode("Pose", "/pose")
    node.CreateAndAddTf2LookupNode("a", "b")
    path = tmp_path / "scene.mrml"
    scene.SetURL(str(path))
    assert scene.Commit()
    again = vtkMRMLScene()
    again.SetURL(str(path))
    assert again.Connect()
    saved = again.GetFirstNodeByName("ros2:pub:/pose")
    assert saved.GetAttribute("ros2.type") == "geometry_msgs/msg/Pose"
    assert again.GetFirstNodeByName("ros2:tf2lookup:aTob").IsA("vtkMRMLLinearTransformNode")
