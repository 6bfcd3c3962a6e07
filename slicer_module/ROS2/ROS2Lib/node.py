"""ROS node in the scene with the calls of SlicerROS2's scripts."""

from app.bridge.world_client import SIMULATION
from ROS2Lib.action_client import vtkMRMLROS2ActionClientNode
from ROS2Lib.host import RosHost
from ROS2Lib.kinds import SERVICES, TOPICS, kind_class, kind_class_name, special_class
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

    def GetPublisherNodeByTopic(self, topic: str) -> vtkMRMLROS2PublisherNode | None:
        """The member; None if there is none."""
        return self.find(vtkMRMLROS2PublisherNode, topic)

    def GetSubscriberNodeByTopic(self, topic: str) -> vtkMRMLROS2SubscriberNode | None:
        """The member; None if there is none."""
        return self.find(vtkMRMLROS2SubscriberNode, topic)

    def GetServiceClientNodeByService(self, service: str) -> vtkMRMLROS2ServiceClientNode | None:
        """The member; None if there is none."""
        return self.find(vtkMRMLROS2ServiceClientNode, service)

    def GetServiceClientNodeByTopic(self, topic: str) -> vtkMRMLROS2ServiceClientNode | None:
        """Return `GetServiceClientNodeByService` of ``topic``."""
        return self.GetServiceClientNodeByService(topic)

    def RemoveAndDeletePublisherNode(self, topic: str) -> bool:
        """Remove it; False if there is none."""
        return self.remove(self.GetPublisherNodeByTopic(topic), f"publisher of {topic!r}")

    def RemoveAndDeleteSubscriberNode(self, topic: str) -> bool:
        """Remove it; False if there is none."""
        return self.remove(self.GetSubscriberNodeByTopic(topic), f"subscriber to {topic!r}")

    def RemoveAndDeleteServiceClientNode(self, service: str) -> bool:
        """Remove it; False if there is none."""
        return self.remove(self.GetServiceClientNodeByService(service), f"client of {service!r}")

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

    def GetServiceServerNodeByService(self, service: str) -> vtkMRMLROS2ServiceServerNode | None:
        """The member; None if there is none."""
        return self.find(vtkMRMLROS2ServiceServerNode, service)

    def RemoveAndDeleteServiceServerNode(self, service: str) -> bool:
        """Remove it; False if there is none."""
        return self.remove(self.GetServiceServerNodeByService(service), f"server of {service!r}")

    def CreateAndAddActionClientNode(
        self, actionType: str, action: str
    ) -> vtkMRMLROS2ActionClientNode | None:
        """Add a client of an action by its ROS type; None if the action already has one."""
        return self.create(kind_class(vtkMRMLROS2ActionClientNode, actionType), action)

    def GetActionClientNodeByAction(self, action: str) -> vtkMRMLROS2ActionClientNode | None:
        """The member; None if there is none."""
        return self.find(vtkMRMLROS2ActionClientNode, action)

    def RemoveAndDeleteActionClientNode(self, action: str) -> bool:
        """Remove it; False if there is none."""
        return self.remove(self.GetActionClientNodeByAction(action), f"client of {action!r}")

    # Parameters of other nodes.

    def CreateAndAddParameterNode(self, nodeName: str) -> vtkMRMLROS2ParameterNode | None:
        """Monitor the parameters of another ROS node; None if they already are."""
        return self.create(vtkMRMLROS2ParameterNode, nodeName)

    def GetParameterNodeByNode(self, nodeName: str) -> vtkMRMLROS2ParameterNode | None:
        """The member; None if there is none."""
        return self.find(vtkMRMLROS2ParameterNode, nodeName)

    def RemoveAndDeleteParameterNode(self, nodeName: str) -> bool:
        """Remove it; False if there is none."""
        return self.remove(self.GetParameterNodeByNode(nodeName), f"parameters of {nodeName!r}")

    def GetParameterNodeByNodeID(self, nodeID: str) -> vtkMRMLROS2ParameterNode | None:
        """The member; None if there is none."""
        return self.find_by_id(vtkMRMLROS2ParameterNode, nodeID)

    def RemoveAndDeleteParameterNodeByNodeID(self, nodeID: str) -> bool:
        """Remove it; False if there is none."""
        return self.remove(self.GetParameterNodeByNodeID(nodeID), f"parameter node {nodeID!r}")

    # tf.

    def CreateAndAddTf2BroadcasterNode(
        self, parent: str, child: str
    ) -> vtkMRMLROS2Tf2BroadcasterNode | None:
        """Add it; None if it already exists."""
        return self.create(vtkMRMLROS2Tf2BroadcasterNode, parent, child)

    def CreateAndAddTf2LookupNode(self, parent: str, child: str) -> vtkMRMLROS2Tf2LookupNode | None:
        """Add it; None if it already exists."""
        return self.create(vtkMRMLROS2Tf2LookupNode, parent, child)

    def GetTf2BroadcasterNodeByParentChild(
        self, parent: str, child: str
    ) -> vtkMRMLROS2Tf2BroadcasterNode | None:
        """The member; None if there is none."""
        return self.find(vtkMRMLROS2Tf2BroadcasterNode, parent, child)

    def GetTf2LookupNodeByParentChild(
        self, parent: str, child: str
    ) -> vtkMRMLROS2Tf2LookupNode | None:
        """The member; None if there is none."""
        return self.find(vtkMRMLROS2Tf2LookupNode, parent, child)

    def GetTf2BroadcasterNodeByID(self, nodeID: str) -> vtkMRMLROS2Tf2BroadcasterNode | None:
        """The member; None if there is none."""
        return self.find_by_id(vtkMRMLROS2Tf2BroadcasterNode, nodeID)

    def GetTf2LookupNodeByID(self, nodeID: str) -> vtkMRMLROS2Tf2LookupNode | None:
        """The member; None if there is none."""
        return self.find_by_id(vtkMRMLROS2Tf2LookupNode, nodeID)

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

    def GetRobotNodeByName(self, robotName: str) -> vtkMRMLROS2RobotNode | None:
        """The member; None if there is none."""
        return self.find(vtkMRMLROS2RobotNode, robotName)

    def RemoveAndDeleteRobotNode(self, robotName: str) -> bool:
        """Remove the robot with its lookups and models; False if there is none."""
        return self.remove(self.GetRobotNodeByName(robotName), f"robot {robotName!r}")

    # Hierarchies of transforms and simulated worlds, which SlicerROS2 does not have.

    def CreateAndAddTf2HierarchyNode(self, parent: str) -> vtkMRMLROS2Tf2HierarchyNode | None:
        """Broadcast a transform in the frame ``parent``, and all below it; None if it exists."""
        return self.create(vtkMRMLROS2Tf2HierarchyNode, parent)

    def GetTf2HierarchyNode(self, parent: str) -> vtkMRMLROS2Tf2HierarchyNode | None:
        """The member; None if there is none."""
        return self.find(vtkMRMLROS2Tf2HierarchyNode, parent)

    def RemoveAndDeleteTf2HierarchyNode(self, parent: str) -> bool:
        """Remove it; False if there is none. Its transforms stay in the scene."""
        return self.remove(self.GetTf2HierarchyNode(parent), f"hierarchy {parent!r}")

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
