"""An ultrasound image in the scene: a textured rectangle at the place of the image."""

import numpy as np
from slicer import vtkMRMLScene, vtkMRMLTransformNode
from vtkmodules.util.numpy_support import numpy_to_vtk
from vtkmodules.vtkCommonCore import vtkPoints
from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkImageData, vtkPolyData
from vtkmodules.vtkCommonExecutionModel import vtkTrivialProducer

from app.geometry import FloatArray, Pixels
from app.scene.nodes.adopted_nodes import PART, mark
from app.scene.nodes.convert import vtk_array
from app.scene.nodes.models import add_model, remove_displayed

NAME = "UltrasoundImage"
_WHITE = (1.0, 1.0, 1.0)


class ImagePlane:
    """A model node that shows an image under the frame of the node ``parent``. Hidden until `show`.

    The rectangle ends half a pixel beyond the centres of the outer pixels. An image whose place is
    not known is hidden: it is never left where it was.
    """

    def __init__(self, scene: vtkMRMLScene, parent: vtkMRMLTransformNode) -> None:
        self._scene = scene
        self._image = vtkImageData()
        self._texture = vtkTrivialProducer()
        self._texture.SetOutput(self._image)
        self._points = vtkPoints()
        self._points.SetNumberOfPoints(4)
        self.node = add_model(scene, NAME, self._surface(), _WHITE, parent=parent)
        mark(self.node, PART)
        display = self.node.GetDisplayNode()
        display.SetAmbient(1.0)
        display.SetDiffuse(0.0)
        display.SetSpecular(0.0)
        display.SetBackfaceCulling(False)
        display.SetTextureImageDataConnection(self._texture.GetOutputPort())
        display.SetVisibility(False)

    @property
    def visible(self) -> bool:
        """True while an image is shown."""
        return bool(self.node.GetDisplayNode().GetVisibility())

    def show(self, pixels: Pixels, matrix: FloatArray) -> None:
        """Show ``pixels`` of 8 bits, (rows, columns) or (rows, columns, 3), first row first.

        ``matrix`` (4, 4) maps (column, row, 0) to mm in the parent's frame.
        """
        rows, columns = pixels.shape[:2]
        self._image.SetDimensions(columns, rows, 1)
        values = np.ascontiguousarray(pixels.reshape(rows * columns, -1), dtype=np.uint8)
        self._image.GetPointData().SetScalars(numpy_to_vtk(values, deep=True))
        self._image.Modified()
        right, below = columns - 0.5, rows - 0.5
        corners = [(-0.5, -0.5), (right, -0.5), (right, below), (-0.5, below)]
        for index, (column, row) in enumerate(corners):
            self._points.SetPoint(index, *(matrix @ (column, row, 0.0, 1.0))[:3])
        self._points.Modified()
        self.node.GetPolyData().Modified()
        self.node.GetDisplayNode().SetVisibility(True)

    def hide(self) -> None:
        """Hide the image."""
        self.node.GetDisplayNode().SetVisibility(False)

    def remove(self) -> None:
        """Remove the node from the scene."""
        remove_displayed(self._scene, self.node)

    def _surface(self) -> vtkPolyData:
        cells = vtkCellArray()
        cells.InsertNextCell(4, [0, 1, 2, 3])
        surface = vtkPolyData()
        surface.SetPoints(self._points)
        surface.SetPolys(cells)
        # Row 0 is the lower one of a texture, so that no row has to be moved.
        places = vtk_array(np.array([(0, 0), (1, 0), (1, 1), (0, 1)], dtype=np.float32))
        surface.GetPointData().SetTCoords(places)
        return surface
