"""Brings the ROS nodes of a loaded scene to life, of a scene saved here or by SlicerROS2.

When a scene has been loaded, its nodes of this module are plain MRML nodes. Each is replaced by a
live one, which joins the ROS graph; references of other nodes follow it (a transform below a lookup
stays there). Loading publishes nothing: a broadcaster does not observe its transform again, and a
service server needs the handler of its script.
"""

import logging
import weakref
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any
from urllib.parse import unquote

from slicer import vtkMRMLLinearTransformNode, vtkMRMLScene, vtkMRMLScriptedModuleNode
from vtkmodules.vtkCommonMath import vtkMatrix4x4

from app.files.xml_guard import read_xml, walk_xml
from app.geometry import MarginGuardError
from ROS2Lib.action_client import vtkMRMLROS2ActionClientNode
from ROS2Lib.class_names import CLASSES, FAMILIES
from ROS2Lib.host import RosHost
from ROS2Lib.kinds import SERVICES, TOPICS, kind_class
from ROS2Lib.member import Member, Ros2Error, SavedState, references
from ROS2Lib.node import vtkMRMLROS2NodeNode
from ROS2Lib.robot_links import ROBOT_ATTRIBUTE

LOOKUP_TAG = "ROS2Tf2Lookup"
_KINDS = MappingProxyType(
    {
        "ROS2Publisher": ("vtkMRMLROS2PublisherNode", TOPICS),
        "ROS2Subscriber": ("vtkMRMLROS2SubscriberNode", TOPICS),
        "ROS2ServiceClient": ("vtkMRMLROS2ServiceClientNode", tuple(SERVICES)),
    }
)
TAGS = (
    "ROS2Node",
    "ROS2Parameter",
    "ROS2RobotNode",
    "ROS2Tf2Broadcaster",
    LOOKUP_TAG,
    *(f"{prefix}{kind}" for prefix, (_, kinds) in _KINDS.items() for kind in kinds),
)
"""Tags of SlicerROS2's nodes. Classes of this module cannot read their XML attributes: the scene
makes the nodes from the MRML base class, and `saved_elements` reads the attributes."""

_MODEL = "_model"


def saved_elements(path: Path) -> list[tuple[str, str, SavedState]]:
    """MRML ID, name and state of SlicerROS2's nodes in a .mrml file, in its order.

    Raises `Ros2Error` for invalid XML.
    """
    elements: list[tuple[str, dict[str, str]]] = []
    walk_xml(
        read_xml(path, Ros2Error),
        path,
        start=lambda tag, attributes: elements.append((tag, attributes)),
        error=Ros2Error,
    )
    by_id = {attributes.get("id", ""): attributes for _, attributes in elements}
    found = []
    for tag, attributes in elements:
        state = _state(tag, attributes, by_id)
        if state is not None:
            found.append((attributes.get("id", ""), attributes.get("name", ""), state))
    return found


def _state(
    tag: str, attributes: dict[str, str], by_id: dict[str, dict[str, str]]
) -> SavedState | None:
    """State of an element; None for one that is not of SlicerROS2."""
    pair = (attributes.get("mParentID", ""), attributes.get("mChildID", ""))
    if tag == "ROS2Node":
        return SavedState("vtkMRMLROS2NodeNode", "", (attributes.get("ROS2NodeName", ""), ""), {})
    if tag == LOOKUP_TAG:
        always = attributes.get("mModifiedOnLookup", "true") == "true"
        settings: dict[str, Any] = {"modified_on_lookup": always}
        return SavedState("vtkMRMLROS2Tf2LookupNode", "", pair, settings)
    if tag == "ROS2Tf2Broadcaster":
        return SavedState("vtkMRMLROS2Tf2BroadcasterNode", "", pair, {})
    if tag == "ROS2Parameter":
        names = (attributes.get("MonitoredNodeName", ""),)
        settings = {"parameters": _parameters(attributes)}
        return SavedState("vtkMRMLROS2ParameterNode", "", names, settings)
    if tag == "ROS2RobotNode":
        return _robot_state(attributes, by_id)
    for prefix, (family, kinds) in _KINDS.items():
        kind = tag.removeprefix(prefix)
        if kind != tag and kind in kinds:
            name = attributes.get("topicName") or attributes.get("serviceName", "")
            return SavedState(family, kind, (name,), {})
    return None


def _robot_state(attributes: dict[str, str], by_id: dict[str, dict[str, str]]) -> SavedState:
    """SlicerROS2 saves only the name; the rest is read from the nodes that the robot refers to."""
    references = _references(attributes)
    node = by_id.get(next(iter(references.get("parameter", [])), ""), {})
    root = by_id.get(next(iter(references.get("lookup", [])), ""), {})
    model = by_id.get(next(iter(references.get("model", [])), ""), {})
    parent, child = root.get("mParentID", ""), root.get("mChildID", "")
    link = model.get("name", "").rpartition(_MODEL)[0]
    is_prefixed = bool(link) and child.endswith(f"/{link}")
    names = (
        attributes.get("RobotName", ""),
        node.get("MonitoredNodeName", ""),
        next(iter(_parameters(node)), "robot_description"),
        "" if parent == child else parent,
        child.removesuffix(f"/{link}") if is_prefixed else "",
    )
    return SavedState("vtkMRMLROS2RobotNode", "", names, {})


def _parameters(attributes: dict[str, str]) -> list[str]:
    """MRML separates the strings of a list by semicolons."""
    names = attributes.get("monitoredParameterNames", "").split(";")
    return [unquote(name) for name in names if name]


def _references(attributes: dict[str, str]) -> dict[str, list[str]]:
    """``references="node:ID;lookup:ID ID;"`` by role."""
    roles = (each.partition(":") for each in attributes.get("references", "").split(";"))
    return {role.strip(): ids.split() for role, _, ids in roles if role.strip()}


MAX_NODES = 1000
"""Most ROS nodes and members that one scene may add to the ROS graph."""

_HOST = vtkMRMLROS2NodeNode.__name__
_ROBOT = "vtkMRMLROS2RobotNode"
_MARK = b"<ROS2"
_FAMILIES = {each.__name__: each for each in (*CLASSES, *FAMILIES, vtkMRMLROS2ActionClientNode)}


@dataclass(frozen=True, slots=True)
class _Saved:
    """A plain node of the loaded scene, and what it was."""

    node: Any
    state: SavedState


class SceneLoader:
    """Observes ``scene`` until `close`; ``default_node`` returns the node for members without."""

    def __init__(self, scene: vtkMRMLScene, default_node: Callable[[], Any]) -> None:
        self._scene = weakref.ref(scene)
        self._default_node = default_node
        for tag in TAGS:
            base = vtkMRMLLinearTransformNode if tag == LOOKUP_TAG else vtkMRMLScriptedModuleNode
            scene.RegisterNodeClass(base(), tag)
        self._observer = scene.AddObserver(vtkMRMLScene.EndImportEvent, self._on_import)

    def close(self) -> None:
        """Stop observing. Idempotent."""
        scene = self._scene()
        if scene is not None:
            scene.RemoveObserver(self._observer)

    def _on_import(self, scene: vtkMRMLScene, _: str) -> None:
        try:
            saved = [*_own(scene), *_of_slicer_ros2(scene)]
            if len(saved) > MAX_NODES:
                logging.error(
                    f"the loaded scene has {len(saved)} ROS 2 nodes; expected at most {MAX_NODES}: "
                    "none of them is created"
                )
                return
            self._revive(scene, saved)
        except MarginGuardError as error:  # nothing catches errors of an observer
            logging.error(f"ROS 2 nodes of the loaded scene: {error}")

    def _revive(self, scene: vtkMRMLScene, saved: list[_Saved]) -> None:
        hosts: dict[str, RosHost] = {}
        for each in saved:
            if each.state.family == _HOST:
                host = _host(scene, each.state)
                if host is not None:
                    hosts[each.node.GetID()] = host
        members = [each for each in saved if each.state.family != _HOST]
        # Robots last: they find the lookups that were theirs.
        for each in sorted(members, key=lambda one: one.state.family == _ROBOT):
            owner = hosts.get(each.node.GetNodeReferenceID("node") or "")
            self._revive_member(scene, each, owner or self._default_node())
        for each in saved:
            host = hosts.get(each.node.GetID())
            if host is not None:
                _replace(scene, each.node, host)
        if saved:
            logging.info(f"{len(saved)} ROS 2 nodes of the loaded scene were created")

    def _revive_member(self, scene: vtkMRMLScene, saved: _Saved, owner: RosHost) -> None:
        state = saved.state
        if state.family == _ROBOT and state.names:
            _prepare_robot(scene, saved, state.names[0])
        base: Any = _FAMILIES[state.family]

        def prepare(member: Member) -> None:
            try:
                member.apply_settings(state.settings)
            except (MarginGuardError, KeyError, TypeError, ValueError) as error:
                if state.settings:
                    logging.error(f"{saved.node.GetName()}: settings are ignored: {error}")

        try:
            made = owner.create(
                kind_class(base, state.kind) if state.kind else base, *state.names, prepare=prepare
            )
        except (TypeError, ValueError) as error:  # another number of names
            logging.error(f"{saved.node.GetName()}: {error}")
            return
        if made is None:
            return
        if isinstance(made, vtkMRMLLinearTransformNode):
            pose = vtkMatrix4x4()
            saved.node.GetMatrixTransformToParent(pose)
            made.SetMatrixTransformToParent(pose)
            made.SetAndObserveTransformNodeID(saved.node.GetTransformNodeID())
            made.SetAttribute(ROBOT_ATTRIBUTE, saved.node.GetAttribute(ROBOT_ATTRIBUTE))
        target = saved.node.GetNodeReferenceID("target")
        if target is not None:
            made.SetTargetNodeID(target)
        source = saved.node.GetNodeReferenceID("source")
        if source is not None and hasattr(made, "SetSourceNodeID"):
            made.SetSourceNodeID(source)
        _replace(scene, saved.node, made)


def _own(scene: vtkMRMLScene) -> Iterator[_Saved]:
    """Nodes of the scene with the attributes of this module that are not live."""
    for node in _nodes(scene):
        if isinstance(node, Member | RosHost):
            continue
        try:
            state = SavedState.load(node)
        except ValueError as error:
            logging.error(f"{node.GetName()}: {error}")
            continue
        if state is not None and state.family in _FAMILIES:
            yield _Saved(node, state)
        elif state is not None:
            logging.warning(f"{node.GetName()} is not created again: it needs its script")


def _of_slicer_ros2(scene: vtkMRMLScene) -> Iterator[_Saved]:
    """Nodes of the scene that SlicerROS2 has saved in the file that was loaded."""
    path = Path(scene.GetURL() or "")
    if not path.is_file() or _MARK not in path.read_bytes():
        return
    loaded = [node for node in _nodes(scene) if not isinstance(node, Member | RosHost)]
    for mrml_id, name, state in saved_elements(path):
        # The scene gives a node another ID if the one in the file is in use.
        names = [node for node in loaded if node.GetName() == name]
        found = next((node for node in names if node.GetID() == mrml_id), None)
        node = found or next(iter(names), None)
        if node is None:
            logging.error(f"{name}: the node was not loaded")
            continue
        loaded.remove(node)
        yield _Saved(node, state)


def _host(scene: vtkMRMLScene, state: SavedState) -> RosHost | None:
    """The live ROS node with these names, or a new one; None, with a log line, on failure."""
    name, namespace = (*state.names, "", "")[:2]
    for node in _nodes(scene):
        if isinstance(node, RosHost) and node.IsCreated():
            there = (node.GetROS2NodeName(), node.GetROS2NodeNamespace())
            if there == (name, f"/{namespace}"):
                return node
    made = vtkMRMLROS2NodeNode()
    scene.AddNode(made)
    try:
        made.Create(name, namespace)
    except MarginGuardError as error:
        logging.error(str(error))
        scene.RemoveNode(made)
        return None
    return made


def _prepare_robot(scene: vtkMRMLScene, saved: _Saved, name: str) -> None:
    """Mark the robot's lookups, and remove its models: it makes them from its description."""
    for lookup in references(saved.node, "lookup"):
        lookup.SetAttribute(ROBOT_ATTRIBUTE, name)
    for model in references(saved.node, "model"):
        for index in range(model.GetNumberOfDisplayNodes()):
            display = model.GetNthDisplayNode(index)
            if display is not None:
                scene.RemoveNode(display)
        scene.RemoveNode(model)


def _replace(scene: vtkMRMLScene, old: Any, new: Any) -> None:
    """Let all references to ``old`` refer to ``new``, and remove ``old``."""
    for node in _nodes(scene):
        if node is not old:
            node.UpdateReferenceID(old.GetID(), new.GetID())
    scene.RemoveNode(old)


def _nodes(scene: vtkMRMLScene) -> list[Any]:
    return [scene.GetNthNode(index) for index in range(scene.GetNumberOfNodes())]
