"""What an earlier `MarginGuardScene` left in a scene that was saved and is open again."""

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
"""The attribute of a node of ours, which a file keeps. Names are no proof: others use them too."""
FRAME, SURFACE, PART = "frame", "surface", "part"


def mark(node: vtkMRMLNode, role: str) -> None:
    """Say that ``node`` is ours; what it was before it stays."""
    if node.GetAttribute(_ROLE) is None:
        node.SetAttribute(_ROLE, role)


@dataclass(frozen=True, slots=True, eq=False)
class Earlier:
    """Nodes to go on with, by name: whatever hangs from them or refers to them stays with them.

    ``frames`` are those of the transform tree, ``surfaces`` the tumour and the tool.
    """

    frames: dict[str, vtkMRMLLinearTransformNode] = field(default_factory=dict)
    surfaces: dict[str, vtkMRMLModelNode] = field(default_factory=dict)

    @classmethod
    def in_scene(cls, scene: vtkMRMLScene) -> "Earlier":
        """What ``scene`` holds; what is made anew anyway (marks, robots) is taken out of it.

        The surfaces are hidden until they are used: what they showed was true when it was saved.
        No browser plays a recording into it any more: its colours would pass for those of now.
        """
        earlier = cls()
        count = scene.GetNumberOfNodes()
        for node in [scene.GetNthNode(place) for place in range(count)]:
            role, name = node.GetAttribute(_ROLE), node.GetName()
            if role is not None:
                _stop_playing(scene, node)
            if role == FRAME:
                earlier.frames.setdefault(name, node)
            elif role == SURFACE and name not in earlier.surfaces:
                earlier.surfaces[name] = node
                node.SetDisplayVisibility(False)
            elif role is not None and isinstance(node, vtkMRMLDisplayableNode):
                remove_displayed(scene, node)
            elif role is not None:
                remove_node(scene, node)
        return earlier


def _stop_playing(scene: vtkMRMLScene, node: vtkMRMLNode) -> None:
    """Take out the browsers whose sequences move or colour ``node``; the sequences stay."""
    played = {node.GetID()}
    if isinstance(node, vtkMRMLDisplayableNode):
        played |= {node.GetNthDisplayNodeID(n) for n in range(node.GetNumberOfDisplayNodes())}
    found = scene.GetNodesByClass(vtkMRMLSequenceBrowserNode.__name__)
    for browser in [found.GetItemAsObject(place) for place in range(found.GetNumberOfItems())]:
        if any(browser.IsProxyNodeID(node_id) for node_id in played):
            scene.RemoveNode(browser)
