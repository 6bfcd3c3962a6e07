"""Publishers and subscribers of the ROS2 module: every kind sent to and received from rclpy."""

import logging

import numpy as np
import pytest
import vtk
import yaml
from vtkmodules.util.numpy_support import numpy_to_vtk

from app.geometry import MarginGuardError
from tests.slicer_module.ros2_values import columns, doubles, flat, ints, matrix, rows, table
from tests.waiting import DEADLINE_S, wait_until

pytestmark = pytest.mark.slow

HALF = np.sqrt(0.5)
POSE = {
    "position": {"x": 0.0125, "y": -1.0, "z": 2.0},
    "orientation": {"x": 0.0, "y": 0.0, "z": float(HALF), "w": float(HALF)},
}
POSE_MATRIX = np.array(
    [[0.0, -1.0, 0.0, 12.5], [1.0, 0.0, 0.0, -1000.0], [0.0, 0.0, 1.0, 2000.0], [0, 0, 0, 1.0]]
)


def bytes_of(array):
    return numpy_to_vtk(
        np.array(array, dtype=np.uint8), deep=True, array_type=vtk.VTK_UNSIGNED_CHAR
    )


def points(*each):
    made = vtk.vtkPoints()
    made.SetDataTypeToDouble()
    for point in each:
        made.InsertNextPoint(point)
    return made


def poly_data(*each):
    made = vtk.vtkPolyData()
    made.SetPoints(points(*each))
    return made


def image(array):
    made = vtk.vtkImageData()
    made.SetDimensions(array.shape[1], array.shape[0], 1)
    flat = array.reshape(array.shape[0] * array.shape[1], -1)
    made.GetPointData().SetScalars(numpy_to_vtk(flat, deep=True))
    return made


GREY = np.array([[1, 2, 3], [4, 5, 6]], dtype=np.uint8)
ROWS_OF_A_TABLE = {
    "dim": [{"label": "x", "size": 3, "stride": 6}, {"label": "y", "size": 2, "stride": 2}],
    "data_offset": 0,
}

# By kind: ROS type, value in Slicer, expected ROS message, check of the received value.
KINDS = {
    "Empty": ("std_msgs/msg/Empty", "", {}, lambda v: v == ""),
    "String": ("std_msgs/msg/String", "xkcd ü", {"data": "xkcd ü"}, lambda v: v == "xkcd ü"),
    "Bool": ("std_msgs/msg/Bool", True, {"data": True}, lambda v: v is True),
    "Int": ("std_msgs/msg/Int64", -(2**40), {"data": -(2**40)}, lambda v: v == -(2**40)),
    "Double": ("std_msgs/msg/Float64", 3.1415, {"data": 3.1415}, lambda v: v == 3.1415),
    "IntArray": (
        "std_msgs/msg/Int64MultiArray",
        ints(1, -2, 3),
        {"data": [1, -2, 3]},
        lambda v: v.IsA("vtkIntArray") and flat(v) == [1, -2, 3],
    ),
    "DoubleArray": (
        "std_msgs/msg/Float64MultiArray",
        doubles(1.1, 2.2),
        {"data": [1.1, 2.2]},
        lambda v: v.IsA("vtkDoubleArray") and flat(v) == [1.1, 2.2],
    ),
    "IntTable": (
        "std_msgs/msg/Int64MultiArray",
        table(ints(0, 3, 6), ints(1, 5, 9)),
        {"layout": ROWS_OF_A_TABLE, "data": [0, 1, 3, 5, 6, 9]},
        lambda v: columns(v) == [[0, 3, 6], [1, 5, 9]],
    ),
    "DoubleTable": (
        "std_msgs/msg/Float64MultiArray",
        table(doubles(0.0, 3.3, 6.6), doubles(1.1, 5.5, 9.9)),
        {"layout": ROWS_OF_A_TABLE, "data": [0.0, 1.1, 3.3, 5.5, 6.6, 9.9]},
        lambda v: columns(v) == [[0.0, 3.3, 6.6], [1.1, 5.5, 9.9]],
    ),
    "Pose": (
        "geometry_msgs/msg/Pose",
        matrix(POSE_MATRIX),
        POSE,
        lambda v: np.allclose(rows(v), POSE_MATRIX, atol=1e-9),
    ),
    "PoseStamped": (
        "geometry_msgs/msg/PoseStamped",
        matrix(POSE_MATRIX),
        {"pose": POSE},
        lambda v: np.allclose(rows(v.GetPose()), POSE_MATRIX, atol=1e-9),
    ),
    "TransformStamped": (
        "geometry_msgs/msg/TransformStamped",
        {"child_frame_id": "tip", "transform": {"translation": {"x": 66.0}}},
        {"child_frame_id": "tip", "transform": {"translation": {"x": 0.066, "y": 0.0, "z": 0.0}}},
        lambda v: (v.GetChildFrameId(), rows(v.GetTransform())[0, 3]) == ("tip", 66.0),
    ),
    "Wrench": (
        "geometry_msgs/msg/Wrench",
        doubles(1.1, 2.2, 3.3, 4.4, 5.5, 6.6),
        {"force": {"x": 1.1, "y": 2.2, "z": 3.3}, "torque": {"x": 4.4, "y": 5.5, "z": 6.6}},
        lambda v: flat(v) == [1.1, 2.2, 3.3, 4.4, 5.5, 6.6],
    ),
    "WrenchStamped": (
        "geometry_msgs/msg/WrenchStamped",
        doubles(1.1, 2.2, 3.3, 4.4, 5.5, 6.6),
        {
            "wrench": {
                "force": {"x": 1.1, "y": 2.2, "z": 3.3},
                "torque": {"x": 4.4, "y": 5.5, "z": 6.6},
            }
        },
        lambda v: flat(v.GetWrench()) == [1.1, 2.2, 3.3, 4.4, 5.5, 6.6],
    ),
    "PoseArray": (
        "geometry_msgs/msg/PoseArray",
        [matrix(POSE_MATRIX), matrix(np.eye(4))],
        {"poses": [POSE, {"position": {"x": 0.0, "y": 0.0, "z": 0.0}}]},
        lambda v: len(v.GetPoses()) == 2 and np.allclose(rows(v.GetPoses()[0]), POSE_MATRIX),
    ),
    "Joy": (
        "sensor_msgs/msg/Joy",
        {"axes": [0.5, -1.0], "buttons": [1, 0, 1]},
        {"axes": [0.5, -1.0], "buttons": [1, 0, 1]},
        lambda v: (v.GetAxes(), v.GetButtons()) == ((0.5, -1.0), (1, 0, 1)),
    ),
    "JointState": (
        "sensor_msgs/msg/JointState",
        {"name": ["turn", "push"], "position": [1.5, 0.25]},
        {"name": ["turn", "push"], "position": [1.5, 0.25]},
        lambda v: (v.GetName(), v.GetPosition()) == (("turn", "push"), (1.5, 0.25)),
    ),
    "UInt8Image": (
        "sensor_msgs/msg/Image",
        bytes_of(GREY),
        {"encoding": "mono8", "width": 3, "height": 2, "step": 3, "data": [1, 2, 3, 4, 5, 6]},
        lambda v: (
            (v.GetNumberOfComponents(), v.GetNumberOfTuples(), flat(v))
            == (3, 2, [1, 2, 3, 4, 5, 6])
        ),
    ),
    "Image": (
        "sensor_msgs/msg/Image",
        image(GREY),
        {"encoding": "mono8", "width": 3, "height": 2, "step": 3, "data": [1, 2, 3, 4, 5, 6]},
        lambda v: (v.GetDimensions(), v.GetScalarComponentAsDouble(2, 1, 0, 0)) == ((3, 2, 1), 6.0),
    ),
    "PointCloud": (
        "sensor_msgs/msg/PointCloud",
        points((1000.0, 500.0, -250.0)),
        {"points": [{"x": 1.0, "y": 0.5, "z": -0.25}]},
        lambda v: v.GetPoint(0) == (1000.0, 500.0, -250.0),
    ),
    "PolyData": (
        "sensor_msgs/msg/PointCloud2",
        poly_data((1000.0, 500.0, -250.0), (0.0, 0.0, 125.0)),
        {"width": 2, "point_step": 12},
        lambda v: (
            (v.GetPoint(0), v.GetPoint(1), v.GetNumberOfVerts())
            == ((1000.0, 500.0, -250.0), (0.0, 0.0, 125.0), 2)
        ),
    ),
}


def contains(message, expected):
    """True if ``message`` contains all fields of ``expected``, recursively."""
    if isinstance(expected, dict):
        return all(contains(message[name], value) for name, value in expected.items())
    if isinstance(expected, list):
        return len(message) == len(expected) and all(map(contains, message, expected))
    return (
        message == pytest.approx(expected) if isinstance(expected, float) else message == expected
    )


@pytest.mark.parametrize("kind", KINDS)
def test_each_kind_is_published_and_received(node, peer, hear, spin_until, kind):
    ros_type, value, expected, is_right = KINDS[kind]
    publisher = node.CreateAndAddPublisherNode(kind, f"/out_{kind}")
    assert publisher.GetROSType() == ros_type
    assert publisher.GetName() == f"ros2:pub:/out_{kind}"
    hear(publisher)
    assert publisher.Publish(value) == 1
    (message,) = peer("take", topic=f"/out_{kind}")
    assert contains(message, expected)

    received = []
    subscriber = node.CreateAndAddSubscriberNode(f"vtkMRMLROS2Subscriber{kind}Node", f"/in_{kind}")
    subscriber.AddObserver(
        "ModifiedEvent", lambda caller, _: received.append(caller.GetLastMessage())
    )
    assert (subscriber.GetLastMessage(), subscriber.GetLastMessageYAML()) == (None, "")
    peer("publish", topic=f"/in_{kind}", type=ros_type, messages=[message])
    spin_until(lambda: received)
    assert is_right(received[0])
    assert subscriber.GetNumberOfMessages() == len(received) == 1
    assert contains(yaml.safe_load(subscriber.GetLastMessageYAML()), expected)


def test_every_message_is_one_event_as_the_last_message(node, peer, spin_until):
    subscriber = node.CreateAndAddSubscriberNode("Int", "/numbers")
    assert (subscriber.GetTopic(), subscriber.GetName()) == ("/numbers", "ros2:sub:/numbers")
    received = []
    subscriber.AddObserver(
        "ModifiedEvent", lambda caller, _: received.append(caller.GetLastMessage())
    )
    messages = [{"data": number} for number in range(8)]
    peer("publish", topic="/numbers", type="std_msgs/msg/Int64", messages=messages)
    spin_until(lambda: len(received) == 8)
    assert received == list(range(8))
    assert subscriber.GetNumberOfMessages() == 8
    node.Spin()
    assert len(received) == 8
    assert subscriber.GetLastMessageYAML() == "data: 7\n"


def test_messages_beyond_the_queue_are_lost_and_counted(logic, node, peer):
    subscriber = logic.AddNewNodeByClass("vtkMRMLROS2SubscriberIntNode")
    subscriber.SetQoSHistoryDepth(3)
    assert subscriber.AddToROS2Node(node.GetID(), "/flood")
    # One by one, because DDS keeps no more than the depth and reports no loss.
    for number in range(5):
        message = {"data": number}
        peer("publish", topic="/flood", type="std_msgs/msg/Int64", messages=[message])
        wait_until(lambda: len(subscriber._queue._raws) + subscriber._queue.lost > number)  # noqa: B023
    received = []
    subscriber.AddObserver(
        "ModifiedEvent", lambda caller, _: received.append(caller.GetLastMessage())
    )
    node.Spin()
    assert received == [2, 3, 4]
    assert subscriber.GetNumberOfMessages() == 3
    assert subscriber.GetNumberOfMessagesLost() == 2
    with pytest.raises(MarginGuardError, match="must be set before it is added"):
        subscriber.SetQoSHistoryDepth(5)


def test_messages_that_are_too_long_are_counted_as_lost(node, peer, monkeypatch):
    subscriber = node.CreateAndAddSubscriberNode("String", "/long")
    monkeypatch.setattr("app.bridge.convert.generic_topics.MAX_BYTES", 50)
    messages = [{"data": "x" * 100}, {"data": "short"}]
    peer("publish", topic="/long", type="std_msgs/msg/String", messages=messages)
    wait_until(lambda: subscriber.GetNumberOfMessages() == 1, node.Spin)
    assert subscriber.GetLastMessage() == "short"
    assert subscriber.GetNumberOfMessagesLost() == 1
    assert node.RemoveAndDeleteSubscriberNode("/long")
    assert subscriber.GetNumberOfMessagesLost() == 1


def test_blank_messages_have_the_kind_and_can_be_published(node):
    classes = {
        "String": str,
        "Bool": bool,
        "Int": int,
        "Double": float,
        "IntArray": vtk.vtkIntArray,
        "DoubleArray": vtk.vtkDoubleArray,
        "IntTable": vtk.vtkTable,
        "Pose": vtk.vtkMatrix4x4,
        "UInt8Image": vtk.vtkTypeUInt8Array,
        "Image": vtk.vtkImageData,
        "PointCloud": vtk.vtkPoints,
        "PolyData": vtk.vtkPolyData,
    }
    for kind, expected in classes.items():
        publisher = node.CreateAndAddPublisherNode(kind, "/blank")
        assert isinstance(publisher.GetBlankMessage(), expected)
        assert publisher.GetSlicerType() == expected.__name__
        assert node.RemoveAndDeletePublisherNode("/blank")
    for kind, name in {
        "PoseStamped": "vtkGeometryMsgsPoseStamped",
        "JointState": "vtkSensorMsgsJointState",
        "geometry_msgs/msg/TwistStamped": "vtkGeometryMsgsTwistStamped",
    }.items():
        publisher = node.CreateAndAddPublisherNode(kind, "/blank")
        blank = publisher.GetBlankMessage()
        assert blank.GetClassName() == name
        assert blank.GetHeader().GetFrameId() == ""
        assert publisher.Publish(blank) == 0
        assert publisher.GetNumberOfMessagesSent() == 1
        assert node.RemoveAndDeletePublisherNode("/blank")


def test_collection_of_transforms_is_a_pose_array(node, peer, hear):
    publisher = node.CreateAndAddPublisherNode("PoseArray", "/poses")
    hear(publisher)
    collection, turn = vtk.vtkTransformCollection(), vtk.vtkTransform()
    turn.SetMatrix(matrix(POSE_MATRIX))
    collection.AddItem(turn)
    publisher.Publish(collection)
    (message,) = peer("take", topic="/poses")
    assert contains(message["poses"], [POSE])


def test_empty_stamp_is_filled_with_the_sending_time(node, peer, hear):
    publisher = node.CreateAndAddPublisherNode("PoseStamped", "/stamped")
    hear(publisher)
    before_ns = node.now_ns()
    publisher.Publish(publisher.GetBlankMessage())
    stamp = peer("take", topic="/stamped")[0]["header"]["stamp"]
    assert before_ns <= stamp["sec"] * 10**9 + stamp["nanosec"] <= node.now_ns()


def test_empty_frame_is_filled_with_the_publishers_frame(node, peer, hear):
    publisher = node.CreateAndAddPublisherNode("PolyData", "/framed")
    publisher.SetFrameId("world")
    assert publisher.GetFrameId() == "world"
    hear(publisher)
    publisher.Publish(poly_data((1.0, 2.0, 3.0)))
    assert peer("take", topic="/framed")[0]["header"]["frame_id"] == "world"
    poses = node.CreateAndAddPublisherNode("PoseStamped", "/framed_pose")
    poses.SetFrameId("world")
    hear(poses)
    poses.Publish({"header": {"frame_id": "needle"}})
    assert peer("take", topic="/framed_pose")[0]["header"]["frame_id"] == "needle"


def test_message_without_subscribers_is_published(logic, node, peer):
    # SlicerROS2 drops it, so that a late subscriber to a latched topic does not receive it.
    publisher = logic.AddNewNodeByClass("vtkMRMLROS2PublisherStringNode")
    publisher.SetQoSHistoryDepth(1)
    publisher.SetQoSReliability(publisher.Reliable)
    publisher.SetQoSDurability(publisher.TransientLocal)
    assert publisher.AddToROS2Node(node.GetID(), "/latched")
    assert publisher.Publish("for late subscribers") == 0
    peer("listen", topic="/latched", type="std_msgs/msg/String", latched=True)
    assert peer("take", topic="/latched") == [{"data": "for late subscribers"}]
    assert (publisher.GetNumberOfCalls(), publisher.GetNumberOfMessagesSent()) == (1, 1)


def test_best_effort_is_received_by_best_effort_only(logic, node, peer, spin_until):
    reliable = node.CreateAndAddSubscriberNode("String", "/lossy")
    other = logic.AddNewNodeByClass("vtkMRMLROS2NodeNode")
    other.Create("lossy")
    best_effort = logic.AddNewNodeByClass("vtkMRMLROS2SubscriberStringNode")
    best_effort.SetQoSReliability(best_effort.BestEffort)
    assert best_effort.AddToROS2Node(other.GetID(), "/lossy")
    message = {"topic": "/lossy", "type": "std_msgs/msg/String", "messages": [{"data": "x"}]}

    def arrived():  # repeated, because best effort may lose messages
        peer("publish", **message, best_effort=True)
        return best_effort.GetNumberOfMessages() > 0

    spin_until(arrived)
    assert reliable.GetNumberOfMessages() == 0
    assert node.ros.incompatible["/lossy"] == "RELIABILITY"


def test_second_publisher_on_a_resolved_topic_is_rejected(node, caplog):
    assert node.CreateAndAddPublisherNode("String", "/twice") is not None
    before = node.GetScene().GetNumberOfNodes()
    for topic in ("/twice", "twice"):
        assert node.CreateAndAddPublisherNode("Int", topic) is None
    assert "slicer already has a publisher 'twice'" in caplog.text
    assert node.GetPublisherNodeByTopic("twice").GetTopic() == "/twice"
    assert node.CreateAndAddSubscriberNode("String", "/twice") is not None
    assert node.GetScene().GetNumberOfNodes() == before + 1


def test_invalid_kinds_and_names_are_rejected_and_leave_nothing(node, caplog):
    before = node.GetScene().GetNumberOfNodes()
    assert node.CreateAndAddPublisherNode("Nothing", "/x") is None
    assert node.CreateAndAddSubscriberNode("nowhere/msg/Nothing", "/x") is None
    assert node.CreateAndAddPublisherNode("String", "two words") is None
    assert node.GetScene().GetNumberOfNodes() == before
    assert [record.levelno for record in caplog.records] == [logging.ERROR] * 3
    assert node.GetPublisherNodeByTopic("two words") is None


def test_values_of_another_kind_are_not_sent(node):
    pose = node.CreateAndAddPublisherNode("Pose", "/refused")
    sheared = np.eye(4)
    sheared[0, 1] = 0.5
    for wrong in (matrix(sheared), "no pose", doubles(1.0)):
        with pytest.raises(MarginGuardError):
            pose.Publish(wrong)
    assert (pose.GetNumberOfCalls(), pose.GetNumberOfMessagesSent()) == (3, 0)
    node.RemoveAndDeletePublisherNode("/refused")
    with pytest.raises(MarginGuardError, match="not on a ROS node"):
        pose.Publish(matrix(np.eye(4)))
    for kind, wrong in {
        "Int": 1.5,
        "String": 3,
        "IntArray": "x",
        "IntTable": ints(1),
        "WrenchStamped": doubles(1.0, 2.0),
        "PoseArray": 5,
        "Joy": 7,
        "Image": matrix(np.eye(4)),
        "PolyData": "points",
    }.items():
        publisher = node.CreateAndAddPublisherNode(kind, "/refused")
        with pytest.raises(MarginGuardError):
            publisher.Publish(wrong)
        assert publisher.GetNumberOfMessagesSent() == 0
        node.RemoveAndDeletePublisherNode("/refused")


@pytest.mark.parametrize(
    ("kind", "ros_type", "message", "text"),
    [
        ("IntArray", "std_msgs/msg/Int64MultiArray", {"data": [2**40]}, "32 bits"),
        ("Pose", "geometry_msgs/msg/Pose", {"orientation": {"w": 0.0}}, "norm 0"),
        ("IntTable", "std_msgs/msg/Int64MultiArray", {"layout": ROWS_OF_A_TABLE}, "has 0 values"),
        ("Image", "sensor_msgs/msg/Image", {"encoding": "yuv"}, "image encoding is 'yuv'"),
        ("Image", "sensor_msgs/msg/Image", {"encoding": "mono8"}, "0 x 0 has no pixels"),
        ("UInt8Image", "sensor_msgs/msg/Image", {"encoding": "rgb8"}, "0 x 0 has no pixels"),
    ],
)
def test_messages_that_cannot_be_converted_raise_on_access(
    node, peer, spin_until, kind, ros_type, message, text
):
    subscriber = node.CreateAndAddSubscriberNode(kind, f"/bad_{kind}")
    peer("publish", topic=f"/bad_{kind}", type=ros_type, messages=[message])
    spin_until(lambda: subscriber.GetNumberOfMessages() == 1)
    with pytest.raises(MarginGuardError, match=text):
        subscriber.GetLastMessage()
    assert subscriber.GetLastMessageYAML()


def test_image_and_cloud_are_shown_by_their_targets(logic, node, peer, spin_until):
    scene = logic.scene
    volume = scene.AddNewNodeByClass("vtkMRMLScalarVolumeNode", "LiveCamera")
    model = scene.AddNewNodeByClass("vtkMRMLModelNode", "LiveLidar")
    images = node.CreateAndAddSubscriberNode("Image", "/camera")
    clouds = node.CreateAndAddSubscriberNode("PolyData", "/lidar")
    images.SetTargetNodeID(volume.GetID())
    clouds.SetTargetNodeID(model.GetID())
    with pytest.raises(MarginGuardError, match="is no vtkMRMLVolumeNode"):
        images.SetTargetNodeID(model.GetID())
    out = node.CreateAndAddPublisherNode("PolyData", "/lidar")
    assert node.ros.wait_for_subscribers(out._publisher.topic, 1, DEADLINE_S)
    out.Publish(poly_data((1.0, 2.0, 3.0), (float("nan"), 0.0, 0.0)))
    picture = {"encoding": "bgr8", "width": 1, "height": 1, "step": 3, "data": [1, 2, 3]}
    peer("publish", topic="/camera", type="sensor_msgs/msg/Image", messages=[picture])
    spin_until(lambda: volume.GetImageData() and model.GetPolyData())
    red_green_blue = [
        volume.GetImageData().GetScalarComponentAsDouble(0, 0, 0, n) for n in range(3)
    ]
    assert red_green_blue == [3.0, 2.0, 1.0]
    assert model.GetPolyData().GetNumberOfPoints() == 1
    assert model.GetPolyData().GetPoint(0) == pytest.approx((1.0, 2.0, 3.0))
    scene.RemoveNode(volume)
    peer("publish", topic="/camera", type="sensor_msgs/msg/Image", messages=[picture])
    spin_until(lambda: images.GetNumberOfMessages() == 2)
    assert images.GetTargetNodeID() == ""
