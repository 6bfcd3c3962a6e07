"""Model of the contour that is being edited."""

from slicer import vtkMRMLDisplayNode, vtkMRMLScene, vtkMRMLTransformNode
from vtkmodules.vtkCommonDataModel import vtkPolyData

from app.geometry import SurfaceMesh
from app.scene.convert import poly_data
from app.scene.models import add_model, remove_displayed
from app.scene.scene_nodes import PART, mark

_CONTOUR_NAME = "Contour"
COLOR = (0.91, 0.61, 1.0)
"""The page draws the contour's points and its line in the image in the same colour."""
_OPACITY = 0.35


class ContourModel:
    """A model node under the frame of the node ``parent``. Hidden until `show`."""

    def __init__(self, scene: vtkMRMLScene, parent: vtkMRMLTransformNode) -> None:
        self._scene = scene
        self.node = add_model(scene, _CONTOUR_NAME, vtkPolyData(), COLOR, parent=parent)
        mark(self.node, PART)
        display = self.node.GetDisplayNode()
        display.SetRepresentation(vtkMRMLDisplayNode.WireframeRepresentation)
        display.SetOpacity(_OPACITY)
        display.SetVisibility(False)

    def show(self, mesh: SurfaceMesh) -> None:
        """Show ``mesh``, in the parent's frame."""
        self.node.SetAndObservePolyData(poly_data(mesh))
        self.node.GetDisplayNode().SetVisibility(True)

    def hide(self) -> None:
        """Hide the surface."""
        self.node.GetDisplayNode().SetVisibility(False)

    def remove(self) -> None:
        """Remove the node from the scene."""
        remove_displayed(self._scene, self.node)
