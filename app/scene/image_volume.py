"""An ultrasound image as a volume node of one slice, for the slice views of 3D Slicer."""

import numpy as np
from slicer import (
    vtkMRMLScene,
    vtkMRMLSliceNode,
    vtkMRMLTransformNode,
    vtkMRMLVolumeNode,
)
from vtkmodules.util.numpy_support import numpy_to_vtk
from vtkmodules.vtkCommonDataModel import vtkImageData
from vtkmodules.vtkCommonMath import vtkMatrix4x4

from app.geometry import FloatArray, Pixels
from app.scene.nodes.adopted_nodes import PART, mark
from app.scene.nodes.convert import world_matrix
from app.scene.nodes.models import remove_displayed

VOLUME_NAME, TRANSFORM_NAME = "Image_Reference", "ImageToReference"
"""Names that SlicerIGT's users know from PLUS."""


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
        self.transform.SetMatrixTransformToParent(_vtk_matrix(matrix))
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
        view.GetSliceToRAS().DeepCopy(_vtk_matrix(ras_from_slice))
        view.UpdateMatrices()


def _vtk_matrix(matrix: FloatArray) -> vtkMatrix4x4:
    found = vtkMatrix4x4()
    found.DeepCopy(np.asarray(matrix, dtype=np.float64).ravel().tolist())
    return found
