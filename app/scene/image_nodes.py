"""An ultrasound image in the scene: a textured rectangle at its place, or a volume of one slice."""

import numpy as np
from slicer import (
    vtkMRMLScene,
    vtkMRMLSliceNode,
    vtkMRMLTransformNode,
    vtkMRMLVolumeNode,
)
from vtkmodules.util.numpy_support import numpy_to_vtk
from vtkmodules.vtkCommonCore import vtkPoints
from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkImageData, vtkPolyData
from vtkmodules.vtkCommonExecutionModel import vtkTrivialProducer

from app.geometry import FloatArray, Pixels
from app.scene.convert import vtk_array, vtk_matrix, world_matrix
from app.scene.models import DisplayedNode, add_model, remove_displayed
from app.scene.scene_nodes import PART, mark

NAME = "UltrasoundImage"
_WHITE = (1.0, 1.0, 1.0)
VOLUME_NAME, TRANSFORM_NAME = "Image_Reference", "ImageToReference"
"""Names that SlicerIGT's users know from PLUS."""


class ImagePlane(DisplayedNode):
    """A model node that shows an image under the frame of the node ``parent``. Hidden until `show`.

    The rectangle ends half a pixel beyond the centres of the outer pixels. An image whose place is
    not known is hidden: it is never left where it was.
    """

    def __init__(self, scene: vtkMRMLScene, parent: vtkMRMLTransformNode) -> None:
        self._image = vtkImageData()
        self._texture = vtkTrivialProducer()
        self._texture.SetOutput(self._image)
        self._points = vtkPoints()
        self._points.SetNumberOfPoints(4)
        super().__init__(scene, add_model(scene, NAME, self._surface(), _WHITE, parent=parent))
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


class ImageVolume:
    """A volume node below a transform node from (column, row, 0) to mm. No pixels until `show`.

    It is a scalar volume for pixels (rows, columns) and a vector volume for (rows, columns, 3),
    ``is_color``. A hidden image has no pixels, so that no view shows an old one.
    """

    def __init__(self, scene: vtkMRMLScene, *, is_color: bool) -> None:
        self._scene = scene
        kind = "Vector" if is_color else "Scalar"
        self.is_color = is_color
        self.transform = scene.AddNewNodeByClass("vtkMRMLLinearTransformNode", TRANSFORM_NAME)
        self.node: vtkMRMLVolumeNode = scene.AddNewNodeByClass(
            f"vtkMRML{kind}VolumeNode", VOLUME_NAME
        )
        mark(self.transform, PART)
        mark(self.node, PART)
        self.node.CreateDefaultDisplayNodes()
        self.node.SetAndObserveTransformNodeID(self.transform.GetID())
        self._pixels: Pixels | None = None

    @property
    def is_in_scene(self) -> bool:
        """False after a user has deleted one of the nodes, or the scene was closed."""
        return all(node.GetScene() is not None for node in (self.node, self.transform))

    @property
    def has_place(self) -> bool:
        """False if the nodes, or the frame that they are placed in, are not in the scene."""
        return self.is_in_scene and self.transform.GetParentTransformNode() is not None

    @property
    def visible(self) -> bool:
        """True while it has an image."""
        return self._pixels is not None

    @property
    def pixel_mm(self) -> tuple[float, float] | None:
        """Width and height of a pixel in mm; None while hidden."""
        if self._pixels is None:
            return None
        width, height = np.linalg.norm(world_matrix(self.transform)[:3, :2], axis=0)
        return float(width), float(height)

    def show(self, pixels: Pixels, matrix: FloatArray, parent: vtkMRMLTransformNode) -> None:
        """Show ``pixels``, first row first, at ``matrix`` (4, 4) in the frame of ``parent``, mm."""
        if self.transform.GetParentTransformNode() is not parent:
            self.transform.SetAndObserveTransformNodeID(parent.GetID())
        self.transform.SetMatrixTransformToParent(vtk_matrix(matrix))
        if pixels is self._pixels:
            return
        rows, columns = pixels.shape[:2]
        image = vtkImageData()
        image.SetDimensions(columns, rows, 1)
        values = np.ascontiguousarray(pixels.reshape(rows * columns, -1))
        image.GetPointData().SetScalars(numpy_to_vtk(values, deep=True))
        self.node.SetAndObserveImageData(image)
        self._pixels = pixels

    def hide(self) -> None:
        """Take the pixels away."""
        if self._pixels is not None:
            self.node.SetAndObserveImageData(None)
            self._pixels = None

    def remove(self) -> None:
        """Remove the nodes from the scene."""
        remove_displayed(self._scene, self.node)
        remove_displayed(self._scene, self.transform)

    def align(self, view: vtkMRMLSliceNode) -> None:
        """Turn and move the slice of ``view`` onto the image: columns to the right, rows down."""
        if self._pixels is None:
            return
        rows, columns = self._pixels.shape[:2]
        place = world_matrix(self.transform)
        right = place[:3, 0] / np.linalg.norm(place[:3, 0])
        normal = np.cross(right, -place[:3, 1])
        normal /= np.linalg.norm(normal)
        ras_from_slice = np.eye(4)
        ras_from_slice[:3, :3] = np.column_stack([right, np.cross(normal, right), normal])
        middle = place @ ((columns - 1) / 2.0, (rows - 1) / 2.0, 0.0, 1.0)
        ras_from_slice[:3, 3] = middle[:3]
        view.GetSliceToRAS().DeepCopy(vtk_matrix(ras_from_slice))
        view.UpdateMatrices()
