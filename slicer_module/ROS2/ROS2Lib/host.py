"""A ROS node as an MRML node: life cycle on the ROS graph, spinning, and its members."""

import logging
from collections.abc import Callable
from typing import Any

import vtk
from slicer import vtkMRMLScene, vtkMRMLScriptedModuleNode
from std_msgs.msg import Header

from app.bridge import RosNode, prepare_environment, topics
from app.bridge.messages import time_message
from app.bridge.ros_errors import reason_of
from app.bridge.tf import TransformBuffer
from app.bridge.tf_topics import TfListener, tf_message
from app.geometry import MarginGuardError, Stamp, Transform
from ROS2Lib.member import Kind, Member, MrmlClass, Ros2Error, SavedState

MemberKey = tuple[str, tuple[str, ...]]


class RosHost(MrmlClass, vtkMRMLScriptedModuleNode):
    """Add it to a scene, `Create` it, call `Spin` often in the scene's thread, `Destroy` it.

    ROS runs in a thread of its own; received data wait for `Spin`, which `call_when_received` can
    call for. Invalid requests (a name in use, an unknown kind) return None and log an error. A
    member that is removed from the scene, by any means, leaves the graph; removing this node from
    the scene destroys the ROS node. Members are MRML references of this node by role:
    ``publisher``, ``subscriber``, ``parameter``, ``lookup``, ``broadcaster``, ``robot``,
    ``service_client``, ``service_server``, ``action_client``.
    """

    def __init__(self) -> None:
        self._ros: RosNode | None = None
        self._name = self._namespace = ""
        self._members: dict[MemberKey, Member] = {}
        self._spinning: set[Member] = set()
        self._spins = False
        self._observer: tuple[vtkMRMLScene, int] | None = None
        self._buffer: TransformBuffer | None = None
        self._broadcaster: Any = None
        self._received: Callable[[], None] = lambda: None

    def Create(self, nodeName: str, nodeNamespace: str = "") -> None:
        """Join the ROS graph under this name; raises `MarginGuardError` on failure.

        The MRML name of a node in a namespace is ``ros2:node:NAMESPACE/NAME``.
        """
        scene = self.GetScene()
        if scene is None:
            raise Ros2Error(f"ROS 2 node {nodeName!r} is in no scene; add it to one first")
        if self._ros is not None:
            raise Ros2Error(
                f"ROS 2 node is already created as {self._name!r}; cannot create it as {nodeName!r}"
            )
        logging.info(prepare_environment())
        self._ros = RosNode(nodeName, namespace=nodeNamespace)
        self._name, self._namespace = nodeName, nodeNamespace.strip("/")
        full = f"/{self._namespace}/{nodeName}" if self._namespace else nodeName
        self.SetName(f"ros2:node:{full}")
        self.SetModuleName("ROS2")
        names = (nodeName, self._namespace)
        SavedState("vtkMRMLROS2NodeNode", "", names, {}).store(self)

        @vtk.calldata_type(vtk.VTK_OBJECT)  # type: ignore[untyped-decorator]  # VTK types none
        def removed(_: object, __: str, node: Any) -> None:
            self._removed(node)

        self._observer = (scene, scene.AddObserver(vtkMRMLScene.NodeRemovedEvent, removed))

    def Destroy(self) -> None:
        """Leave the graph and remove the node and all members from the scene. Idempotent."""
        scene = self.GetScene()
        self._close()
        if scene is not None:
            scene.RemoveNode(self)

    def Spin(self) -> None:
        """Transfer received data into the scene; does nothing after `Destroy`.

        Reentrant: an observer may call it, also through Slicer's timer (``processEvents``). The
        member whose event is being processed is then skipped, so that its events keep their order.
        """
        self._spins = True
        for key, member in tuple(self._members.items()):
            if self._members.get(key) is not member or member in self._spinning:
                continue  # removed by an observer, or its event is being processed
            self._spinning.add(member)
            try:
                member.spin()
            except MarginGuardError as error:
                logging.error(f"{member.GetName()}: {error}")
            except Exception:  # the other members must still spin, or they would not become stale
                logging.exception(f"{member.GetName()} failed")
            finally:
                self._spinning.discard(member)

    def GetSpinning(self) -> bool:
        """True once `Spin` was called on a created node, until `Destroy`."""
        return self._spins and self.IsCreated()

    def WarnIfNotSpinning(self, contextMessage: str) -> None:
        """Log a warning that names the context if nothing calls `Spin`."""
        if not self.GetSpinning():
            logging.warning(f"{contextMessage}: {self.GetName()} is not spinning; call Spin")

    def GetROS2NodeName(self) -> str:
        """Name on the ROS graph."""
        return self._name

    def GetROS2NodeNamespace(self) -> str:
        """Namespace on the ROS graph, ``/`` if there is none."""
        return f"/{self._namespace}"

    def IsCreated(self) -> bool:
        """True while it is on the ROS graph."""
        return self._ros is not None

    @property
    def ros(self) -> RosNode:
        """The node on the graph."""
        if self._ros is None:
            raise Ros2Error(
                f"{self.GetName() or 'a ROS 2 node'} is not on the graph; call Create first"
            )
        return self._ros

    @property
    def buffer(self) -> TransformBuffer:
        """Transforms received on tf since the first use of this property."""
        if self._buffer is None:
            self._buffer = TransformBuffer()
            TfListener(self.ros, self._buffer, received=self.wake)
        return self._buffer

    def broadcast(self, pose: Transform, stamp: Stamp) -> None:
        """Send a pose on tf; the parent is its target."""
        if self._broadcaster is None:
            self._broadcaster = self.ros.publisher(topics.TF)
        self._broadcaster.publish(tf_message([(pose, stamp)]))

    def call_when_received(self, callback: Callable[[], None]) -> None:
        """Call ``callback()``, in any thread, whenever data have arrived that wait for `Spin`."""
        self._received = callback

    def wake(self) -> None:
        """Signal that data wait for `Spin`. Thread-safe."""
        self._received()

    def now_ns(self) -> int:
        """Time in ns on the node's clock, which is ``/clock`` with ``use_sim_time``."""
        return int(self.ros.node.get_clock().now().nanoseconds)

    def stamp(self, message: Any, frame_id: str) -> None:
        """Fill in an empty stamp with the present and an empty frame with ``frame_id``."""
        header = getattr(message, "header", None)
        if not isinstance(header, Header):
            return
        if header.stamp.sec == 0 and header.stamp.nanosec == 0:
            header.stamp = time_message(Stamp(self.now_ns()))
        header.frame_id = header.frame_id or frame_id

    def resolve(self, name: str) -> str:
        """Resolved name of a topic or service; raises `Ros2Error` for an invalid one."""
        try:
            return str(self.ros.node.resolve_topic_name(name))
        except MarginGuardError:
            raise
        except Exception as error:  # rclpy raises unrelated types for the different errors
            raise Ros2Error(f"{name!r} is no valid name: {reason_of(error)}") from error

    def adopt(self, member: Member, names: tuple[str, ...]) -> None:
        """Add a member; raises `MarginGuardError` if its name is in use or it has an owner."""
        if member.IsAddedToROS2Node():
            raise Ros2Error(f"{member.GetName()} is already on a ROS 2 node")
        key = (member.ROLE, member.key(self, *names))
        if key in self._members:
            raise Ros2Error(f"{self._name} already has a {member.ROLE} {' '.join(names)!r}")
        member.join(self, names)
        self._members[key] = member
        self.AddNodeReferenceID(member.reference_role(), member.GetID())

    @property
    def members(self) -> tuple[Member, ...]:
        """All members, in the order of their creation."""
        return tuple(self._members.values())

    def create(
        self, kind: type[Kind], *names: str, prepare: Callable[[Kind], None] = lambda _: None
    ) -> Kind | None:
        """Create a member in the scene after ``prepare(member)``; on error log it, return None."""
        scene = self.GetScene()
        try:
            member = kind()
            if scene is None or self._ros is None:
                name = self.GetName() or "a ROS 2 node"
                raise Ros2Error(f"{name} is not on the graph; call Create first")
            prepare(member)
        except MarginGuardError as error:
            logging.error(str(error))
            return None
        scene.AddNode(member)
        if not member.add_to(self.GetID(), names):
            scene.RemoveNode(member)
            return None
        return member

    def find(self, kind: type[Kind], *names: str) -> Kind | None:
        """The member of this kind and name; None if there is none."""
        try:
            found = self._members.get((kind.ROLE, kind.key(self, *names)))
        except MarginGuardError:  # an invalid name belongs to no member
            return None
        return found if isinstance(found, kind) else None

    def find_by_id(self, kind: type[Kind], node_id: str) -> Kind | None:
        """The member of this kind with this MRML ID; None if there is none."""
        each = (member for member in self._members.values() if isinstance(member, kind))
        return next((member for member in each if member.GetID() == node_id), None)

    def remove(self, member: Member | None, what: str) -> bool:
        """Remove ``member`` from graph and scene; for None log ``what`` and return False."""
        if member is None:
            logging.warning(f"{self._name} has no {what}: nothing is removed")
            return False
        self._remove_member(member)
        return True

    def release(self, member: Member) -> None:
        """Remove a member from the graph; it stays in the scene and can be added again."""
        self._members = {key: each for key, each in self._members.items() if each is not member}
        role, node_id = member.reference_role(), member.GetID()
        for index in reversed(range(self.GetNumberOfNodeReferences(role))):
            if self.GetNthNodeReferenceID(role, index) == node_id:
                self.RemoveNthNodeReferenceID(role, index)
        member.leave()

    def _remove_member(self, member: Member) -> None:
        scene = member.GetScene()
        try:
            self.release(member)
        finally:
            if scene is not None:
                scene.RemoveNode(member)

    def _removed(self, node: Any) -> None:
        if node is self:
            self._close()
        elif node in self._members.values():
            self._remove_member(node)

    def _close(self) -> None:
        if self._observer is not None:
            scene, observer = self._observer
            self._observer = None
            scene.RemoveObserver(observer)
        # Robots first: they remove the lookups that they created.
        for member in sorted(self._members.values(), key=lambda each: each.ROLE != "robot"):
            if member in self._members.values():
                try:
                    self._remove_member(member)
                except MarginGuardError as error:  # the others must still be closed
                    logging.error(f"{member.GetName()}: {error}")
        if self._ros is not None:
            self._ros.close()
            self._ros = None
        self._buffer = self._broadcaster = None
