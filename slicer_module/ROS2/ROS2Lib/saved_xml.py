"""Nodes of SlicerROS2 in a saved scene, read from its .mrml file.

SlicerROS2's classes write XML attributes of their own, which the classes of this module cannot
read: the scene makes them from the MRML base class (`TAGS`), and this file reads the attributes.
"""

from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any
from urllib.parse import unquote

from app.files.xml_guard import read_xml, walk_xml
from ROS2Lib.errors import Ros2Error
from ROS2Lib.kinds import SERVICES, TOPICS
from ROS2Lib.saved_state import SavedState

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
_MODEL = "_model"


@dataclass(frozen=True, slots=True)
class SavedElement:
    """A node of SlicerROS2: its MRML ID and name in the file, state, and referred IDs by role."""

    mrml_id: str
    name: str
    state: SavedState
    references: dict[str, list[str]] = field(default_factory=dict)


def saved_elements(path: Path) -> list[SavedElement]:
    """SlicerROS2's nodes in a .mrml file, in its order; raises `Ros2Error` for invalid XML."""
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
            identifier, name = attributes.get("id", ""), attributes.get("name", "")
            found.append(SavedElement(identifier, name, state, _references(attributes)))
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
