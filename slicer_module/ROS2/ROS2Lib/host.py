"""A ROS node in the scene: on the graph, spun, and with members that come and go."""

import logging
from collections.abc import Callable
from typing import Any

import vtk
from slicer import vtkMRMLScene, vtkMRMLScriptedModuleNode
from std_msgs.msg import Header

from app.bridge import RosNode, prepare_environment
from app.bridge.errors import reason_of
from app.bridge.messages import time_message
from app.bridge.tf import TransformBuffer
from app.bridge.tf.broadcaster import TfBroadcaster
from app.bridge.tf.listener import TfListener
from app.geometry import MarginGuardError, Stamp
from ROS2Lib.errors import Ros2Error
from ROS2Lib.member import Kind, Member

MemberKey = tuple[str, tuple[str, ...]]


class RosHost(vtkMRMLScriptedModuleNode):
    """Put it into a scene, `Create` it, call `Spin` often in the scene's thread, `Destroy` it.

    ROS runs in a thread of its own; what comes waits for `Spin`. What is refused (a name in use,
    a kind that is none) is None, and said in the log. A member that is taken out of the scene by
    whatever means leaves the graph, and the ROS node ends when it is taken out itself.
    """

    def __init__(self) -> None:
        self._ros: RosNode | None = None
        self._name = ""
        self._members: dict[MemberKey, Member] = {}
        self._spinning: set[Member] = set()
        self._observer: tuple[vtkMRMLScene, int] | None = None
        self._buffer: TransformBuffer | None = None
        self._broadcaster: TfBroadcaster | None = None

    def GetClassName(self) -> str:
        """The name that the class has in SlicerROS2."""
        return type(self).__name__

    def Create(self, nodeName: str) -> None:
        """Join the ROS graph by that name; raises `MarginGuardError` when it cannot."""
        scene = self.GetScene()
        if scene is None:
            raise Ros2Error(f"ROS 2 node {nodeName!r} is in no scene: add it to one first")
        if self._ros is not None:
            raise Ros2Error(f"ROS 2 node {self._name!r} is there already, and not {nodeName!r}")
        logging.info(prepare_environment())
        self._ros = RosNode(nodeName)
        self._name = nodeName
        self.SetName(f"ros2:node:{nodeName}")
        self.SetModuleName("ROS2")

        @vtk.calldata_type(vtk.VTK_OBJECT)  # type: ignore[untyped-decorator]  # VTK types none
        def removed(_: object, __: str, node: Any) -> None:
            self._removed(node)

        self._observer = (scene, scene.AddObserver(vtkMRMLScene.NodeRemovedEvent, removed))

    def Destroy(self) -> None:
        """Leave the graph and take every member, and the node, out of the scene; once is enough."""
        scene = self.GetScene()
        self._close()
        if scene is not None:
            scene.RemoveNode(self)

    def Spin(self) -> None:
        """Bring what has come into the scene; nothing after `Destroy`.

        An observer may call it, or let Slicer's timer do so (``processEvents``): the member that
        is telling it something is left out, so that what it tells keeps its order.
        """
        for key, member in tuple(self._members.items()):
            if self._members.get(key) is not member or member in self._spinning:
                continue  # an observer has removed it, or is being told
            self._spinning.add(member)
            try:
                member.spin()
            except MarginGuardError as error:
                logging.error(f"{member.GetName()}: {error}")
            except Exception:  # whatever it is: without their spin the others would not turn stale
                logging.exception(f"{member.GetName()} failed")
            finally:
                self._spinning.discard(member)

    def GetROS2NodeName(self) -> str:
        """Its name on the ROS graph."""
        return self._name

    def IsCreated(self) -> bool:
        """Whether it is on the ROS graph."""
        return self._ros is not None

    @property
    def ros(self) -> RosNode:
        """The node on the graph."""
        if self._ros is None:
            raise Ros2Error(f"{self.GetName() or 'a ROS 2 node'} is not on the graph: Create it")
        return self._ros

    @property
    def buffer(self) -> TransformBuffer:
        """What tf has said since this was asked for first."""
        if self._buffer is None:
            self._buffer = TransformBuffer()
            TfListener(self.ros, self._buffer)
        return self._buffer

    @property
    def broadcaster(self) -> TfBroadcaster:
        """One for all members."""
        if self._broadcaster is None:
            self._broadcaster = TfBroadcaster(self.ros)
        return self._broadcaster

    def now_ns(self) -> int:
        """Now on the node's clock, which ``use_sim_time`` makes that of ``/clock``."""
        return int(self.ros.node.get_clock().now().nanoseconds)

    def stamp(self, message: Any, frame_id: str) -> None:
        """Fill a header in where its sender left it: the stamp with now, the frame with this."""
        header = getattr(message, "header", None)
        if not isinstance(header, Header):
            return
        if header.stamp.sec == 0 and header.stamp.nanosec == 0:
            header.stamp = time_message(Stamp(self.now_ns()))
        header.frame_id = header.frame_id or frame_id

    def resolve(self, name: str) -> str:
        """The full name of a topic or service; raises `Ros2Error` for what is none."""
        try:
            return str(self.ros.node.resolve_topic_name(name))
        except MarginGuardError:
            raise
        except Exception as error:  # rclpy has an unrelated type for each way to be invalid
            raise Ros2Error(f"no name {name!r}: {reason_of(error)}") from error

    def adopt(self, member: Member, names: tuple[str, ...]) -> None:
        """Take a member on; raises `MarginGuardError` when that is refused."""
        if member.IsAddedToROS2Node():
            raise Ros2Error(f"{member.GetName()} is on a ROS 2 node already")
        key = (member.ROLE, member.key(self, *names))
        if key in self._members:
            raise Ros2Error(f"{self._name} has a {member.ROLE} {' '.join(names)!r} already")
        member.join(self, names)
        self._members[key] = member

    @property
    def members(self) -> tuple[Member, ...]:
        """All of them, in the order in which they came."""
        return tuple(self._members.values())

    def create(
        self, kind: type[Kind], *names: str, prepare: Callable[[Kind], None] = lambda _: None
    ) -> Kind | None:
        """A new member in the scene, which `prepare` sees first; None, and said, when refused."""
        scene = self.GetScene()
        try:
            member = kind()
            if scene is None or self._ros is None:
                name = self.GetName() or "a ROS 2 node"
                raise Ros2Error(f"{name} is not on the graph: Create it")
        except MarginGuardError as error:
            logging.error(str(error))
            return None
        prepare(member)
        scene.AddNode(member)
        if not member.AddToROS2Node(self.GetID(), *names):
            scene.RemoveNode(member)
            return None
        return member

    def find(self, kind: type[Kind], *names: str) -> Kind | None:
        """The member of that kind and name; None when there is none."""
        try:
            found = self._members.get((kind.ROLE, kind.key(self, *names)))
        except MarginGuardError:  # a name that cannot be is nobody's
            return None
        return found if isinstance(found, kind) else None

    def find_by_id(self, kind: type[Kind], node_id: str) -> Kind | None:
        """The member of that kind whose node in the scene has this ID; None when there is none."""
        each = (member for member in self._members.values() if isinstance(member, kind))
        return next((member for member in each if member.GetID() == node_id), None)

    def remove(self, member: Member | None, what: str) -> bool:
        """Take ``member`` out of graph and scene; False, and said by ``what`` it is, for None."""
        if member is None:
            logging.warning(f"{self._name} has no {what}: nothing is removed")
            return False
        self._let_go(member)
        return True

    def _let_go(self, member: Member) -> None:
        scene = member.GetScene()
        self._members = {key: each for key, each in self._members.items() if each is not member}
        try:
            member.leave()
        finally:
            if scene is not None:
                scene.RemoveNode(member)

    def _removed(self, node: Any) -> None:
        if node is self:
            self._close()
        elif node in self._members.values():
            self._let_go(node)

    def _close(self) -> None:
        if self._observer is not None:
            scene, observer = self._observer
            self._observer = None
            scene.RemoveObserver(observer)
        # Robots before the lookups that they have made.
        for member in sorted(self._members.values(), key=lambda each: each.ROLE != "robot"):
            if member in self._members.values():
                try:
                    self._let_go(member)
                except MarginGuardError as error:  # the others, and the node, end all the same
                    logging.error(f"{member.GetName()}: {error}")
        if self._ros is not None:
            self._ros.close()
            self._ros = None
        self._buffer = self._broadcaster = None
