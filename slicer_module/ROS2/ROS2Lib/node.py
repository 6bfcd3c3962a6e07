"""A ROS node in the scene, with the calls that SlicerROS2's scripts make."""

from ROS2Lib.action_client import vtkMRMLROS2ActionClientNode
from ROS2Lib.classes import kind_class, kind_class_name
from ROS2Lib.host import RosHost
from ROS2Lib.kinds import SERVICES, TOPICS
from ROS2Lib.parameter import vtkMRMLROS2ParameterNode
from ROS2Lib.publisher import vtkMRMLROS2PublisherNode
from ROS2Lib.robot import vtkMRMLROS2RobotNode
from ROS2Lib.service_client import vtkMRMLROS2ServiceClientNode
from ROS2Lib.service_server import Handler, vtkMRMLROS2ServiceServerNode
from ROS2Lib.subscriber import vtkMRMLROS2SubscriberNode
from ROS2Lib.tf2_broadcaster import vtkMRMLROS2Tf2BroadcasterNode
from ROS2Lib.tf2_lookup import vtkMRMLROS2Tf2LookupNode


class vtkMRMLROS2NodeNode(RosHost):
    """`RosHost` says how it lives; here is what can hang on it."""

    # Publishers, subscribers and service clients.

    def CreateAndAddPublisherNode(
        self, className: str, topic: str
    ) -> vtkMRMLROS2PublisherNode | None:
        """A publisher of a kind (`ROS2Lib.kinds`); None when the topic has one already."""
        return self.create(kind_class(vtkMRMLROS2PublisherNode, className), topic)

    def CreateAndAddSubscriberNode(
        self, className: str, topic: str
    ) -> vtkMRMLROS2SubscriberNode | None:
        """A subscriber of a kind; None when the topic has one already."""
        return self.create(kind_class(vtkMRMLROS2SubscriberNode, className), topic)

    def CreateAndAddServiceClientNode(
        self, className: str, service: str
    ) -> vtkMRMLROS2ServiceClientNode | None:
        """A client of a kind of service; None when the service has one already."""
        return self.create(kind_class(vtkMRMLROS2ServiceClientNode, className), service)

    def GetPublisherNodeByTopic(self, topic: str) -> vtkMRMLROS2PublisherNode | None:
        """None when there is none."""
        return self.find(vtkMRMLROS2PublisherNode, topic)

    def GetSubscriberNodeByTopic(self, topic: str) -> vtkMRMLROS2SubscriberNode | None:
        """None when there is none."""
        return self.find(vtkMRMLROS2SubscriberNode, topic)

    def GetServiceClientNodeByService(self, service: str) -> vtkMRMLROS2ServiceClientNode | None:
        """None when there is none."""
        return self.find(vtkMRMLROS2ServiceClientNode, service)

    def RemoveAndDeletePublisherNode(self, topic: str) -> bool:
        """False when there is none."""
        return self.remove(self.GetPublisherNodeByTopic(topic), f"publisher of {topic!r}")

    def RemoveAndDeleteSubscriberNode(self, topic: str) -> bool:
        """False when there is none."""
        return self.remove(self.GetSubscriberNodeByTopic(topic), f"subscriber to {topic!r}")

    def RemoveAndDeleteServiceClientNode(self, service: str) -> bool:
        """False when there is none."""
        return self.remove(self.GetServiceClientNodeByService(service), f"client of {service!r}")

    def RegisteredROS2PublisherNodes(self) -> str:
        """The classes that have a short name, one a line."""
        return "\n".join(kind_class_name(vtkMRMLROS2PublisherNode, name) for name in TOPICS)

    def RegisteredROS2SubscriberNodes(self) -> str:
        """The classes that have a short name, one a line."""
        return "\n".join(kind_class_name(vtkMRMLROS2SubscriberNode, name) for name in TOPICS)

    def RegisteredROS2ServiceClientNodes(self) -> str:
        """The classes that have a short name, one a line."""
        return "\n".join(kind_class_name(vtkMRMLROS2ServiceClientNode, name) for name in SERVICES)

    # Services of our own, and actions of others: SlicerROS2 has neither.

    def CreateAndAddServiceServerNode(
        self, className: str, service: str, handler: Handler
    ) -> vtkMRMLROS2ServiceServerNode | None:
        """Answer a service by ``handler(request, response)``; None when it is answered already."""
        kind = kind_class(vtkMRMLROS2ServiceServerNode, className)
        return self.create(kind, service, prepare=lambda server: server.SetHandler(handler))

    def GetServiceServerNodeByService(self, service: str) -> vtkMRMLROS2ServiceServerNode | None:
        """None when there is none."""
        return self.find(vtkMRMLROS2ServiceServerNode, service)

    def RemoveAndDeleteServiceServerNode(self, service: str) -> bool:
        """False when there is none."""
        return self.remove(self.GetServiceServerNodeByService(service), f"server of {service!r}")

    def CreateAndAddActionClientNode(
        self, actionType: str, action: str
    ) -> vtkMRMLROS2ActionClientNode | None:
        """A client of an action by its type in ROS; None when the action has one already."""
        return self.create(kind_class(vtkMRMLROS2ActionClientNode, actionType), action)

    def GetActionClientNodeByAction(self, action: str) -> vtkMRMLROS2ActionClientNode | None:
        """None when there is none."""
        return self.find(vtkMRMLROS2ActionClientNode, action)

    def RemoveAndDeleteActionClientNode(self, action: str) -> bool:
        """False when there is none."""
        return self.remove(self.GetActionClientNodeByAction(action), f"client of {action!r}")

    # Parameters of other nodes.

    def CreateAndAddParameterNode(self, nodeName: str) -> vtkMRMLROS2ParameterNode | None:
        """The parameters of another ROS node; None when they are monitored already."""
        return self.create(vtkMRMLROS2ParameterNode, nodeName)

    def GetParameterNodeByNode(self, nodeName: str) -> vtkMRMLROS2ParameterNode | None:
        """None when there is none."""
        return self.find(vtkMRMLROS2ParameterNode, nodeName)

    def RemoveAndDeleteParameterNode(self, nodeName: str) -> bool:
        """False when there is none."""
        return self.remove(self.GetParameterNodeByNode(nodeName), f"parameters of {nodeName!r}")

    # tf.

    def CreateAndAddTf2BroadcasterNode(
        self, parent: str, child: str
    ) -> vtkMRMLROS2Tf2BroadcasterNode | None:
        """None when there is one already."""
        return self.create(vtkMRMLROS2Tf2BroadcasterNode, parent, child)

    def CreateAndAddTf2LookupNode(self, parent: str, child: str) -> vtkMRMLROS2Tf2LookupNode | None:
        """None when there is one already."""
        return self.create(vtkMRMLROS2Tf2LookupNode, parent, child)

    def GetTf2BroadcasterNodeByParentChild(
        self, parent: str, child: str
    ) -> vtkMRMLROS2Tf2BroadcasterNode | None:
        """None when there is none."""
        return self.find(vtkMRMLROS2Tf2BroadcasterNode, parent, child)

    def GetTf2LookupNodeByParentChild(
        self, parent: str, child: str
    ) -> vtkMRMLROS2Tf2LookupNode | None:
        """None when there is none."""
        return self.find(vtkMRMLROS2Tf2LookupNode, parent, child)

    def GetTf2BroadcasterNodeByID(self, nodeID: str) -> vtkMRMLROS2Tf2BroadcasterNode | None:
        """None when there is none."""
        return self.find_by_id(vtkMRMLROS2Tf2BroadcasterNode, nodeID)

    def GetTf2LookupNodeByID(self, nodeID: str) -> vtkMRMLROS2Tf2LookupNode | None:
        """None when there is none."""
        return self.find_by_id(vtkMRMLROS2Tf2LookupNode, nodeID)

    def RemoveAndDeleteTf2BroadcasterNode(self, parent: str, child: str = "") -> bool:
        """By parent and child, or by the id of the node; False when there is none."""
        found = (
            self.GetTf2BroadcasterNodeByParentChild(parent, child)
            if child
            else self.GetTf2BroadcasterNodeByID(parent)
        )
        return self.remove(found, f"broadcaster {parent!r} {child!r}")

    def RemoveAndDeleteTf2LookupNode(self, parent: str, child: str = "") -> bool:
        """By parent and child, or by the id of the node; False when there is none."""
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
    ) -> vtkMRMLROS2RobotNode | None:
        """A robot that a parameter of another node describes; None when the name is in use."""
        names = (robotName, parameterNodeName, parameterName, fixedFrame, tfPrefix)
        return self.create(vtkMRMLROS2RobotNode, *names)

    def GetRobotNodeByName(self, robotName: str) -> vtkMRMLROS2RobotNode | None:
        """None when there is none."""
        return self.find(vtkMRMLROS2RobotNode, robotName)

    def RemoveAndDeleteRobotNode(self, robotName: str) -> bool:
        """The robot with its lookups and models; False when there is none."""
        return self.remove(self.GetRobotNodeByName(robotName), f"robot {robotName!r}")
