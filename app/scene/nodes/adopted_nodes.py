"""Nodes of an earlier `MarginGuardScene` in a scene that was saved and loaded again."""

from dataclasses import dataclass, field

from slicer import (
    vtkMRMLDisplayableNode,
    vtkMRMLLinearTransformNode,
    vtkMRMLModelNode,
    vtkMRMLNode,
    vtkMRMLScene,
    vtkMRMLSequenceBrowserNode,
)

from app.scene.nodes.models import remove_displayed, remove_node

_ROLE = "MarginGuard"
"""Attribute of our nodes, kept in files. Names are not enough: others use them, too."""
FRAME, SURFACE, PART = "frame", "surface", "part"


def mark(node: vtkMRMLNode, role: str) -> None:
    """Mark ``node`` as ours; a role that it already has stays."""
    if node.GetAttribute(_ROLE) is None:
        node.SetAttribute(_ROLE, role)


def is_marked(node: vtkMRMLNode) -> bool:
    """True if ``node`` is one of ours."""
    return node.GetAttribute(_ROLE) is not None


@dataclass(frozen=True, slots=True, eq=False)
class AdoptedNodes:
    """Nodes to reuse, by name, so that nodes of others that refer to them keep doing so.

    ``frames`` are those of the transform tree, ``surfaces`` the tumour and the tool.
    """

    frames: dict[str, vtkMRMLLinearTransformNode] = field(default_factory=dict)
    surfaces: dict[str, vtkMRMLModelNode] = field(default_factory=dict)

    @classmethod
    def in_scene(cls, scene: vtkMRMLScene) -> "AdoptedNodes":
        """Find the nodes in ``scene``; remove those that are created again (marks, robots).

        The surfaces are hidden until they are used, because their colours are those of the time of
        saving. Sequence browsers that play into our nodes are removed for the same reason.
        """
        adopted = cls()
        count = scene.GetNumberOfNodes()
        for node in [scene.GetNthNode(index) for index in range(count)]:
            role, name = node.GetAttribute(_ROLE), node.GetName()
            if role is not None:
                _stop_playing(scene, node)
            if role == FRAME:
                adopted.frames.setdefault(name, node)
            elif role == SURFACE and name not in adopted.surfaces:
                adopted.surfaces[name] = node
                node.SetDisplayVisibility(False)
            elif role is not None and isinstance(node, vtkMRMLDisplayableNode):
                remove_displayed(scene, node)
            elif role is not None:
                remove_node(scene, node)
        return adopted


def _stop_playing(scene: vtkMRMLScene, node: vtkMRMLNode) -> None:
    """Remove browsers whose sequences move or colour ``node``; the sequences stay."""
    played = {node.GetID()}
    if isinstance(node, vtkMRMLDisplayableNode):
        played |= {node.GetNthDisplayNodeID(n) for n in range(node.GetNumberOfDisplayNodes())}
    found = scene.GetNodesByClass(vtkMRMLSequenceBrowserNode.__name__)
    for browser in [found.GetItemAsObject(index) for index in range(found.GetNumberOfItems())]:
        if any(browser.IsProxyNodeID(node_id) for node_id in played):
            scene.RemoveNode(browser)
