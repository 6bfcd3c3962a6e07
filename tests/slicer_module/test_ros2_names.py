"""Names, classes, references and constants by which SlicerROS2's scripts find things."""

import inspect
from types import SimpleNamespace

import pytest
import slicer
import vtk

from app.bridge.convert import UnknownTypeError
from app.geometry import MarginGuardError
from tests.slicer_module.ros2_values import translation
from tests.slicer_module.test_ros2_topics import KINDS

pytestmark = pytest.mark.slow

NAMES = {
    "vtkMRMLROS2NodeNode": """
        Create Destroy Spin GetROS2NodeName GetSpinning WarnIfNotSpinning
        CreateAndAddPublisherNode CreateAndAddSubscriberNode CreateAndAddServiceClientNode
        CreateAndAddParameterNode CreateAndAddTf2BroadcasterNode CreateAndAddTf2LookupNode
        CreateAndAddRobotNode GetPublisherNodeByTopic GetSubscriberNodeByTopic
        GetServiceClientNodeByService GetServiceClientNodeByTopic GetParameterNodeByNode
        GetParameterNodeByNodeID GetTf2BroadcasterNodeByID GetTf2BroadcasterNodeByParentChild
        GetTf2LookupNodeByID GetTf2LookupNodeByParentChild GetRobotNodeByName
        RemoveAndDeletePublisherNode RemoveAndDeleteSubscriberNode RemoveAndDeleteServiceClientNode
        RemoveAndDeleteParameterNode RemoveAndDeleteParameterNodeByNodeID
        RemoveAndDeleteTf2BroadcasterNode RemoveAndDeleteTf2LookupNode RemoveAndDeleteRobotNode
        RegisteredROS2PublisherNodes RegisteredROS2SubscriberNodes
        RegisteredROS2ServiceClientNodes""",
    "vtkMRMLROS2PublisherNode": """
        AddToROS2Node RemoveFromROS2Node IsAddedToROS2Node GetTopic GetROSType GetSlicerType
        GetBlankMessage Publish GetNumberOfCalls GetNumberOfMessagesSent SetQoSHistoryDepth
        SetQoSReliability SetQoSDurability Reliable BestEffort TransientLocal Volatile
        ReliabilitySystemDefault DurabilitySystemDefault""",
    "vtkMRMLROS2SubscriberNode": """
        AddToROS2Node RemoveFromROS2Node IsAddedToROS2Node GetTopic GetROSType GetSlicerType
        GetLastMessage GetLastMessageYAML GetLastMessageVariant GetNumberOfMessages GetBlankMessage
        SetQoSHistoryDepth SetQoSReliability SetQoSDurability Reliable TransientLocal""",
    "vtkMRMLROS2ServiceClientNode": """
        AddToROS2Node RemoveFromROS2Node IsAddedToROS2Node GetService GetROSType GetSlicerTypeIn
        GetSlicerTypeOut CreateBlankRequest PreRequestCheck SendAsyncRequest GetLastResponse
        GetLastResponseStatus GetNumberOfCalls GetNumberOfRequestsSent ServiceModifiedEvent
        ResponseReceivedEvent""",
    "vtkMRMLROS2ParameterNode": """
        AddToROS2Node RemoveFromROS2Node IsAddedToROS2Node IsMonitoredNodeReady
        GetMonitoredNodeName AddParameter RemoveParameter IsParameterSet ParameterSet
        GetParameterType PrintParameter PrintParameterValue GetParameterAsBool
        GetParameterAsInteger GetParameterAsDouble GetParameterAsString GetParameterAsVectorOfBools
        GetParameterAsVectorOfIntegers GetParameterAsVectorOfDoubles GetParameterAsVectorOfStrings
        ParameterModifiedEvent""",
    "vtkMRMLROS2Tf2BroadcasterNode": """
        AddToROS2Node RemoveFromROS2Node IsAddedToROS2Node SetParentID GetParentID SetChildID
        GetChildID IsParentAndChildSet Broadcast ObserveTransformNode""",
    "vtkMRMLROS2Tf2LookupNode": """
        AddToROS2Node RemoveFromROS2Node IsAddedToROS2Node SetParentID GetParentID SetChildID
        GetChildID IsParentAndChildSet SetModifiedOnLookup GetModifiedOnLookup
        IsDifferentFromLast""",
    "vtkMRMLROS2RobotNode": """
        AddToROS2Node RemoveFromROS2Node GetRobotName SetRobotName SetRobotDescriptionParameterNode
        ObserveParameterNode ParseRobotDescription SetupRobotVisualization
        RemoveRobotVisualization CreateGoalStateRobot RemoveGoalStateRobot SetupKDLIKWithLimits
        FindRootAndTipLinks GetSegments GetJoints GetJointTypes GetJointLowerPositionLimits
        GetJointUpperPositionLimits GetJointVelocityLimits ComputeKDLFK ComputeKDLIK FindKDLIK
        ComputeLocalTransform SetupIKMoveIt ComputeMoveItIK setupIKmoveit FindIKmoveit""",
}


@pytest.fixture(scope="module")
def namespace():
    """Stands for the module ``slicer``, to which the panel adds the classes."""
    from ROS2Lib.class_names import register_classes

    made = SimpleNamespace()
    register_classes(made)
    return made


@pytest.mark.parametrize("role", ["Publisher", "Subscriber"])
def test_every_kind_has_a_class_below_the_base_class(namespace, logic, node, role):
    base = getattr(namespace, f"vtkMRMLROS2{role}Node")
    registered = getattr(node, f"RegisteredROS2{role}Nodes")()
    assert isinstance(registered, str)
    of_moveit = f"vtkMRMLROS2{role}CollisionObjectNode"  # its package may be missing
    names = {f"vtkMRMLROS2{role}{kind}Node" for kind in KINDS}
    assert {*registered.split("\n")} == {*names, of_moveit}
    for kind in KINDS:
        name = f"vtkMRMLROS2{role}{kind}Node"
        created = logic.AddNewNodeByClass(name)
        assert created.GetClassName() == name
        made = getattr(namespace, name)()
        assert made.IsA(name)
        assert made.IsA(base.__name__)
        assert made.IsA("vtkMRMLNode")
        assert base.SafeDownCast(made) is made
        assert made.GetNodeTagName() == f"ROS2{role}{kind}"
    with pytest.raises(MarginGuardError):
        base()  # abstract: it has no kind
    with pytest.raises(UnknownTypeError):
        logic.AddNewNodeByClass(f"vtkMRMLROS2{role}NothingNode")


@pytest.mark.parametrize(
    ("name", "names", "takes"),
    [
        ("GetPublisherNodeByTopic", (), "name: str"),
        ("RemoveAndDeletePublisherNode", ("/a", "/b"), "name: str"),
        ("GetTf2LookupNodeByParentChild", ("base",), "parent: str, child: str"),
        ("GetTf2LookupNodeByID", (), "nodeID: str"),
    ],
)
def test_wrong_number_of_names_is_an_error_that_shows_the_call(node, name, names, takes):
    call = getattr(node, name)
    assert f"({takes})" in str(inspect.signature(call))
    with pytest.raises(TypeError, match=rf"vtkMRMLROS2NodeNode\.{name}\(\)"):
        call(*names)


def test_registered_classes_are_one_per_line(node):
    publishers = node.RegisteredROS2PublisherNodes().split("\n")
    subscribers = node.RegisteredROS2SubscriberNodes().split("\n")
    assert "vtkMRMLROS2PublisherPoseNode" in publishers
    assert [each.replace("Publisher", "Subscriber") for each in publishers] == subscribers


def test_messages_have_constructors_and_constants(namespace):
    header = namespace.vtkStdMsgsHeader()
    header.SetFrameId("needle")
    assert (header.GetFrameId(), header.GetStamp().GetSec()) == ("needle", 0)
    assert header.GetStamp().GetClassName() == "vtkBuiltinInterfacesTime"
    stamped = namespace.vtkGeometryMsgsPoseStamped()
    stamped.SetHeader(header)
    assert isinstance(stamped.GetPose(), vtk.vtkMatrix4x4)
    copied = stamped.NewInstance()
    copied.DeepCopy(stamped)
    header.SetFrameId("changed")
    assert copied.GetHeader().GetFrameId() == "needle"
    assert namespace.vtkSensorMsgsPointField.FLOAT32 == 7
    assert namespace.vtkStdSrvsSetBoolRequest().GetData() is False
    assert namespace.vtkStdMsgsHeader.SafeDownCast(stamped) is None
    with pytest.raises(AttributeError, match="vtkStdMsgsHeader has no GetNothing"):
        header.GetNothing()


def test_node_in_a_namespace(logic, peer):
    made = logic.AddNewNodeByClass("vtkMRMLROS2NodeNode")
    made.Create("helper", "/station")
    assert (made.GetName(), made.GetROS2NodeName()) == ("ros2:node:/station/helper", "helper")
    assert made.GetROS2NodeNamespace() == "/station"
    made.CreateAndAddPublisherNode("String", "relative")
    peer("wait_until", call={"do": "endpoints", "topic": "/station/relative"}, value=[1, 0])


def test_default_node_is_not_saved_with_the_scene(logic, node):
    assert not node.GetSaveWithScene()
    other = logic.AddNewNodeByClass("vtkMRMLROS2NodeNode")
    other.Create("saved")
    assert other.GetSaveWithScene()


def test_scene_makes_and_finds_nodes_by_their_class_names(logic, node):
    scene = logic.scene
    publisher = scene.AddNewNodeByClass("vtkMRMLROS2PublisherStringNode", "own name")
    assert (publisher.GetName(), publisher.GetScene()) == ("own name", scene)
    assert scene.CreateNodeByClass("vtkMRMLROS2Tf2LookupNode").GetScene() is None
    assert scene.GetFirstNodeByClass("vtkMRMLROS2PublisherNode") is publisher
    assert scene.GetNumberOfNodesByClass("vtkMRMLROS2PublisherNode") == 1
    assert scene.GetNthNodeByClass(0, "vtkMRMLROS2PublisherStringNode") is publisher
    assert scene.GetNthNodeByClass(1, "vtkMRMLROS2PublisherStringNode") is None
    found = scene.GetNodesByClass("vtkMRMLROS2NodeNode")
    assert [found.GetItemAsObject(0), found.GetNumberOfItems()] == [node, 1]
    with pytest.raises(MarginGuardError, match="no class of the ROS2 module"):
        scene.AddNewNodeByClass("vtkMRMLROS2NothingNode")
    # Other classes are the scene's own.
    text = scene.AddNewNodeByClass("vtkMRMLTextNode", "text")
    assert scene.GetFirstNodeByClass("vtkMRMLTextNode") is text
    assert scene.GetNumberOfNodesByClass("vtkMRMLTextNode") == 1
    for each in (publisher, text):
        scene.RemoveNode(each)


def test_closed_logic_leaves_the_scene_as_it_was():
    from ROS2Lib.logic import Ros2Api

    scene = slicer.vtkMRMLScene()
    api = Ros2Api(scene)
    assert "AddNewNodeByClass" in vars(scene)
    api.Close()
    api.Close()
    assert "AddNewNodeByClass" not in vars(scene)
    assert scene.AddNewNodeByClass("vtkMRMLROS2NodeNode") is None


def test_stamp_of_a_lookup_is_compared_with_the_last_one(namespace):
    lookup = namespace.vtkMRMLROS2Tf2LookupNode()
    stamps = ((0, 0), (1, 0), (1, 0), (1, 5), (0, 0))
    different = [lookup.IsDifferentFromLast(*stamp) for stamp in stamps]
    assert different == [False, True, False, True, True]


def test_robot_computes_and_shows_a_goal(logic, node, describe, spin_until):
    robot = logic.AddNewNodeByClass("vtkMRMLROS2RobotNode")
    # The order of names of its present version, and of the older one with a leading slash.
    assert robot.AddToROS2Node(node.GetID(), "arm", "robot_state_publisher", "robot_description")
    assert robot.GetRobotName() == "arm"
    assert not robot.ParseRobotDescription()
    assert robot.ComputeKDLFK((0.5,), vtk.vtkMatrix4x4()) is None
    assert robot.SetRobotDescriptionParameterNode() is True
    parameters = robot.GetNodeReference("parameter")
    assert parameters is node.GetParameterNodeByNode("/robot_state_publisher")
    spin_until(robot.ParseRobotDescription)
    spin_until(lambda: parameters.ParameterSet("robot_description"))
    assert robot.FindRootAndTipLinks() == ("base", "tip")
    assert (robot.GetSegments(), robot.GetJoints()) == (("wrist", "tip"), ("turn",))
    assert robot.GetJointTypes() == ("revolute",)
    assert (robot.GetJointLowerPositionLimits(), robot.GetJointUpperPositionLimits()) == (
        (-3.0,),
        (3.0,),
    )
    pose, local = vtk.vtkMatrix4x4(), vtk.vtkMatrix4x4()
    assert robot.ComputeKDLFK((vtk.vtkMath.Pi() / 2,), pose) is pose
    assert translation(pose) == pytest.approx([0.0, 300.0, 100.0])
    assert robot.ComputeLocalTransform((0.2,), local, "tip") is local
    assert local.GetElement(0, 3) == pytest.approx(300.0)
    assert robot.ComputeKDLIK(pose, (1.0,)) == pytest.approx((vtk.vtkMath.Pi() / 2,))
    pose.SetElement(2, 3, 900.0)
    assert robot.ComputeKDLIK(pose) == ()
    assert robot.ComputeKDLFK((1.0, 2.0), pose) is None
    assert robot.ComputeLocalTransform((1.0,), pose, "nothing") is None
    scene = logic.scene
    assert robot.CreateGoalStateRobot(robot) is True
    goal = scene.GetFirstNodeByName("tip_model_goal")
    assert goal.GetParentTransformNode().GetName() == "tip_goal_transform"
    assert robot.GetNumberOfNodeReferences("goal_model") == 2
    assert goal.GetDisplayNode().GetOpacity() == pytest.approx(0.3)
    assert robot.RemoveGoalStateRobot() is True
    assert scene.GetFirstNodeByName("tip_model_goal") is None
    robot.RemoveRobotVisualization()
    node.Spin()
    assert robot.GetLinkNames() == ()
    robot.SetupRobotVisualization()
    assert robot.GetLinkNames() == ("base", "wrist", "tip")
    assert node.RemoveAndDeleteRobotNode("arm") is True
    assert node.RemoveAndDeleteParameterNodeByNodeID(parameters.GetID()) is True
    assert scene.GetFirstNodeByName("tip_model") is None
