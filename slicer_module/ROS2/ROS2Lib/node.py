"""ROS node in the scene with the calls of SlicerROS2's scripts."""

from collections.abc import Callable
from typing import TypeVar

from app.bridge.world_client import SIMULATION
from ROS2Lib.action_client import vtkMRMLROS2ActionClientNode
from ROS2Lib.host import RosHost
from ROS2Lib.kinds import SERVICES, TOPICS, kind_class, kind_class_name, special_class
from ROS2Lib.member import Member
from ROS2Lib.parameter import vtkMRMLROS2ParameterNode
from ROS2Lib.robot import PARAMETER, vtkMRMLROS2RobotNode
from ROS2Lib.service_nodes import (
    Handler,
    vtkMRMLROS2ServiceClientNode,
    vtkMRMLROS2ServiceServerNode,
)
from ROS2Lib.simulated_world import vtkMRMLROS2SimulatedWorldNode
from ROS2Lib.tf2_hierarchy import vtkMRMLROS2Tf2HierarchyNode
from ROS2Lib.tf2_nodes import vtkMRMLROS2Tf2BroadcasterNode, vtkMRMLROS2Tf2LookupNode
from ROS2Lib.topic_nodes import (
    vtkMRMLROS2PublisherCollisionObjectNode,
    vtkMRMLROS2PublisherNode,
    vtkMRMLROS2SubscriberNode,
)

special_class(
    vtkMRMLROS2PublisherNode,
    "moveit_msgs/msg/CollisionObject",
    vtkMRMLROS2PublisherCollisionObjectNode,
)


Found = TypeVar("Found", bound=Member)


def _by_name(kind: type[Found]) -> Callable[..., Found | None]:
    def get(self: RosHost, name: str) -> Found | None:
        """The member; None if there is none."""
        return self.find(kind, name)

    return get


def _by_frames(kind: type[Found]) -> Callable[..., Found | None]:
    def get(self: RosHost, parent: str, child: str) -> Found | None:
        """The member; None if there is none."""
        return self.find(kind, parent, child)

    return get


def _by_id(kind: type[Found]) -> Callable[..., Found | None]:
    def get(self: RosHost, nodeID: str) -> Found | None:
        """The member; None if there is none."""
        return self.find_by_id(kind, nodeID)

    return get


def _remover(get: Callable[..., Member | None], what: str) -> Callable[..., bool]:
    def remove(self: RosHost, name: str) -> bool:
        """Remove the member, with what it has made; False if there is none."""
        return self.remove(get(self, name), what.format(name))

    return remove


class vtkMRMLROS2NodeNode(RosHost):
    """Adds the members' calls to `RosHost`, which implements the life cycle."""

    # Publishers, subscribers and service clients.

    def CreateAndAddPublisherNode(
        self, className: str, topic: str
    ) -> vtkMRMLROS2PublisherNode | None:
        """Add a publisher of a kind (`ROS2Lib.kinds`); None if the topic already has one."""
        return self.create(kind_class(vtkMRMLROS2PublisherNode, className), topic)

    def CreateAndAddSubscriberNode(
        self, className: str, topic: str
    ) -> vtkMRMLROS2SubscriberNode | None:
        """Add a subscriber of a kind; None if the topic already has one."""
        return self.create(kind_class(vtkMRMLROS2SubscriberNode, className), topic)

    def CreateAndAddServiceClientNode(
        self, className: str, service: str
    ) -> vtkMRMLROS2ServiceClientNode | None:
        """Add a client of a kind of service; None if the service already has one."""
        return self.create(kind_class(vtkMRMLROS2ServiceClientNode, className), service)

    GetPublisherNodeByTopic = _by_name(vtkMRMLROS2PublisherNode)

    GetSubscriberNodeByTopic = _by_name(vtkMRMLROS2SubscriberNode)

    GetServiceClientNodeByService = _by_name(vtkMRMLROS2ServiceClientNode)

    GetServiceClientNodeByTopic = _by_name(vtkMRMLROS2ServiceClientNode)

    RemoveAndDeletePublisherNode = _remover(GetPublisherNodeByTopic, "publisher of {!r}")

    RemoveAndDeleteSubscriberNode = _remover(GetSubscriberNodeByTopic, "subscriber to {!r}")

    RemoveAndDeleteServiceClientNode = _remover(GetServiceClientNodeByService, "client of {!r}")

    def RegisteredROS2PublisherNodes(self) -> str:
        """Class names of all short names, one per line."""
        return "\n".join(kind_class_name(vtkMRMLROS2PublisherNode, name) for name in TOPICS)

    def RegisteredROS2SubscriberNodes(self) -> str:
        """Class names of all short names, one per line."""
        return "\n".join(kind_class_name(vtkMRMLROS2SubscriberNode, name) for name in TOPICS)

    def RegisteredROS2ServiceClientNodes(self) -> str:
        """Class names of all short names, one per line."""
        return "\n".join(kind_class_name(vtkMRMLROS2ServiceClientNode, name) for name in SERVICES)

    # Service servers and action clients, which SlicerROS2 does not have.

    def CreateAndAddServiceServerNode(
        self, className: str, service: str, handler: Handler
    ) -> vtkMRMLROS2ServiceServerNode | None:
        """Serve a service by ``handler(request, response)``; None if it already has a server."""
        kind = kind_class(vtkMRMLROS2ServiceServerNode, className)
        return self.create(kind, service, prepare=lambda server: server.SetHandler(handler))

    GetServiceServerNodeByService = _by_name(vtkMRMLROS2ServiceServerNode)

    RemoveAndDeleteServiceServerNode = _remover(GetServiceServerNodeByService, "server of {!r}")

    def CreateAndAddActionClientNode(
        self, actionType: str, action: str
    ) -> vtkMRMLROS2ActionClientNode | None:
        """Add a client of an action by its ROS type; None if the action already has one."""
        return self.create(kind_class(vtkMRMLROS2ActionClientNode, actionType), action)

    GetActionClientNodeByAction = _by_name(vtkMRMLROS2ActionClientNode)

    RemoveAndDeleteActionClientNode = _remover(GetActionClientNodeByAction, "client of {!r}")

    # Parameters of other nodes.

    def CreateAndAddParameterNode(self, nodeName: str) -> vtkMRMLROS2ParameterNode | None:
        """Monitor the parameters of another ROS node; None if they already are."""
        return self.create(vtkMRMLROS2ParameterNode, nodeName)

    GetParameterNodeByNode = _by_name(vtkMRMLROS2ParameterNode)

    RemoveAndDeleteParameterNode = _remover(GetParameterNodeByNode, "parameters of {!r}")

    GetParameterNodeByNodeID = _by_id(vtkMRMLROS2ParameterNode)

    RemoveAndDeleteParameterNodeByNodeID = _remover(GetParameterNodeByNodeID, "parameter node {!r}")

    # tf.

    def CreateAndAddTf2BroadcasterNode(
        self, parent: str, child: str
    ) -> vtkMRMLROS2Tf2BroadcasterNode | None:
        """Add it; None if it already exists."""
        return self.create(vtkMRMLROS2Tf2BroadcasterNode, parent, child)

    def CreateAndAddTf2LookupNode(self, parent: str, child: str) -> vtkMRMLROS2Tf2LookupNode | None:
        """Add it; None if it already exists."""
        return self.create(vtkMRMLROS2Tf2LookupNode, parent, child)

    GetTf2BroadcasterNodeByParentChild = _by_frames(vtkMRMLROS2Tf2BroadcasterNode)

    GetTf2LookupNodeByParentChild = _by_frames(vtkMRMLROS2Tf2LookupNode)

    GetTf2BroadcasterNodeByID = _by_id(vtkMRMLROS2Tf2BroadcasterNode)

    GetTf2LookupNodeByID = _by_id(vtkMRMLROS2Tf2LookupNode)

    def RemoveAndDeleteTf2BroadcasterNode(self, parent: str, child: str = "") -> bool:
        """Remove by parent and child, or by MRML ID; False if there is none."""
        found = (
            self.GetTf2BroadcasterNodeByParentChild(parent, child)
            if child
            else self.GetTf2BroadcasterNodeByID(parent)
        )
        return self.remove(found, f"broadcaster {parent!r} {child!r}")

    def RemoveAndDeleteTf2LookupNode(self, parent: str, child: str = "") -> bool:
        """Remove by parent and child, or by MRML ID; False if there is none."""
        found = (
            self.GetTf2LookupNodeByParentChild(parent, child)
            if child
            else self.GetTf2LookupNodeByID(parent)
        )
        return self.remove(found, f"lookup {parent!r} {child!r}")

    # Robots.

    def CreateAndAddRobotNode(
        self,
        robotName: str,
        parameterNodeName: str,
        parameterName: str = "robot_description",
        fixedFrame: str = "",
        tfPrefix: str = "",
        source: str = PARAMETER,
        jointStates: str = "",
    ) -> vtkMRMLROS2RobotNode | None:
        """Add a robot described by a parameter of another node; None if the name is in use.

        With another ``source`` (`vtkMRMLROS2RobotNode.SetDescriptionSource`) ``parameterName`` is
        the name of a topic or a file. With ``jointStates``, a topic, the links do not follow tf.
        """

        def prepare(robot: vtkMRMLROS2RobotNode) -> None:
            robot.SetDescriptionSource(source)
            robot.SetJointStatesTopic(jointStates)

        names = (robotName, parameterNodeName, parameterName, fixedFrame, tfPrefix)
        return self.create(vtkMRMLROS2RobotNode, *names, prepare=prepare)

    GetRobotNodeByName = _by_name(vtkMRMLROS2RobotNode)

    RemoveAndDeleteRobotNode = _remover(GetRobotNodeByName, "robot {!r}")

    # Hierarchies of transforms and simulated worlds, which SlicerROS2 does not have.

    def CreateAndAddTf2HierarchyNode(self, parent: str) -> vtkMRMLROS2Tf2HierarchyNode | None:
        """Broadcast a transform in the frame ``parent``, and all below it; None if it exists."""
        return self.create(vtkMRMLROS2Tf2HierarchyNode, parent)

    GetTf2HierarchyNode = _by_name(vtkMRMLROS2Tf2HierarchyNode)

    RemoveAndDeleteTf2HierarchyNode = _remover(GetTf2HierarchyNode, "hierarchy {!r}")

    def CreateAndAddSimulatedWorldNode(
        self, simulation: str = SIMULATION
    ) -> vtkMRMLROS2SimulatedWorldNode | None:
        """Show the bodies of the node ``simulation`` as transforms that a user may move."""
        return self.create(vtkMRMLROS2SimulatedWorldNode, simulation)

    def GetSimulatedWorldNode(
        self, simulation: str = SIMULATION
    ) -> vtkMRMLROS2SimulatedWorldNode | None:
        """The member; None if there is none."""
        return self.find(vtkMRMLROS2SimulatedWorldNode, simulation)

    def RemoveAndDeleteSimulatedWorldNode(self, simulation: str = SIMULATION) -> bool:
        """Remove it with its transforms; False if there is none."""
        return self.remove(self.GetSimulatedWorldNode(simulation), f"world {simulation!r}")
