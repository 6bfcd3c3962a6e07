"""The cut of a volume through the tool's tip: anatomical planes, and one along the tool."""

from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from scipy.ndimage import map_coordinates

from app.files.volume_file import Volume
from app.fixture import MarginState
from app.geometry import FloatArray, ImageSample, ImageStatus, SurfaceMesh, Transform
from app.scene import SceneError, forward_of
from app.viewer.steps.plane_lines import ImageView, PlaneLines, root_from_tumor
from app.viewer.steps.view_state import ViewState

SIDE = 360
"""Columns and rows."""
PIXEL_MM = 0.3
_WINDOW = (1.0, 99.0)
"""Percentiles of the values that are shown as black and white."""

_LEFT, _BACK, _DOWN = (-1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, -1.0)


class ReslicePlane(StrEnum):
    """A plane through the tip. Anatomical ones are seen as in 3D Slicer."""

    AXIAL = "axial"
    SAGITTAL = "sagittal"
    CORONAL = "coronal"
    TOOL = "along the tool"


_AXES = {
    ReslicePlane.AXIAL: (_LEFT, _BACK),
    ReslicePlane.SAGITTAL: (_BACK, _DOWN),
    ReslicePlane.CORONAL: (_LEFT, _DOWN),
}
"""Directions of columns and rows, in RAS."""


@dataclass(frozen=True, slots=True, eq=False)
class _Cut:
    plane: ReslicePlane
    matrix: FloatArray
    image: ImageSample


class Reslice:
    """Cuts ``volume``, whose RAS axes are those of the tumour's frame.

    Cuts have the numbers -1, -2, ..., which no ultrasound image has. One is computed when the plane
    has moved by a hundredth of a pixel. Not thread-safe: the page's thread owns it.
    """

    def __init__(self, volume: Volume) -> None:
        self._volume = volume
        self._index_from_ras = np.linalg.inv(volume.ras_from_index)
        low, high = np.percentile(volume.values[::2, ::2, ::2], _WINDOW)
        self._low, self._span = float(low), max(float(high - low), 1e-6)
        self._cut: _Cut | None = None
        self._lines = PlaneLines()
        self._number = 0

    def at(self, shown: ViewState | None, root: str | None, plane: ReslicePlane) -> ImageView:
        """The cut of the step of ``shown``, placed in the frame ``root`` of the scene."""
        if shown is None or root is None:
            return ImageView(None, None, "tool and tumour have no place yet")
        if shown.silent:
            return ImageView(None, None, shown.silent)
        tip, tumor = shown.step.tumor_from_tip, root_from_tumor(shown, root)
        if shown.step.decision.state is MarginState.UNKNOWN or tip is None or tumor is None:
            return ImageView(None, None, "the place of the tool in the tumour is not known")
        cut = self._cut_at(plane, plane_matrix(plane, tip, _tool_axis(shown.content.tool)))
        matrix = tumor.matrix @ cut.matrix
        view = ImageView(cut.image, matrix, "", cut.image.number, edges=edges(cut.matrix))
        return self._lines.added(view, shown, tumor, tip)

    def pixels(self, matrix: FloatArray) -> FloatArray:
        """The values (`SIDE`, `SIDE`) at (column, row, 0), which ``matrix`` (4, 4) maps to mm RAS.

        Interpolated between the eight voxels around each; the lowest shown value outside.
        """
        index = self._index_from_ras @ matrix
        columns, rows = np.meshgrid(np.arange(SIDE), np.arange(SIDE))
        places = (
            index[:3, 0, None, None] * columns
            + index[:3, 1, None, None] * rows
            + index[:3, 3, None, None]
        )
        return np.asarray(
            map_coordinates(self._volume.values, places, order=1, cval=self._low), np.float64
        )

    def _cut_at(self, plane: ReslicePlane, matrix: FloatArray) -> _Cut:
        last = self._cut
        if (
            last is not None
            and last.plane is plane
            and np.allclose(last.matrix, matrix, rtol=0.0, atol=0.01 * PIXEL_MM)
        ):
            return last
        shown = (self.pixels(matrix) - self._low) * (255.0 / self._span)
        pixels = np.clip(np.round(shown), 0, 255).astype(np.uint8)
        self._number -= 1
        image = ImageSample(self._number, None, ImageStatus.OK, pixels)
        self._cut = _Cut(plane, matrix, image)
        return self._cut


def _tool_axis(tool: SurfaceMesh | None) -> FloatArray | None:
    """Direction to the tip in the tool's frame; None without a surface on one side of the tip."""
    try:
        return None if tool is None else forward_of(tool)
    except SceneError:
        return None


def plane_matrix(
    plane: ReslicePlane, tumor_from_tip: Transform, tool_axis: FloatArray | None
) -> FloatArray:
    """(4, 4) from (column, row, 0) to mm in the tumour's frame; the tip is in the middle.

    ``tool_axis`` (3,) points to the tip in the tool's frame, None for a tool without a surface,
    whose plane is the sagittal one. Along the tool rows go in its direction, and columns along the
    direction across it that is nearest to the patient's left.
    """
    if plane is ReslicePlane.TOOL and tool_axis is not None:
        row = tumor_from_tip.rotate(tool_axis)
        across = [np.array(each) - (row @ each) * row for each in (_LEFT, _BACK)]
        column = across[0] if np.linalg.norm(across[0]) > 0.1 else across[1]
        column = column / np.linalg.norm(column)
    else:
        column, row = map(np.array, _AXES.get(plane, _AXES[ReslicePlane.SAGITTAL]))
    matrix = np.eye(4)
    matrix[:3, 0], matrix[:3, 1] = PIXEL_MM * column, PIXEL_MM * row
    matrix[:3, 2] = np.cross(column, row)
    middle = 0.5 * (SIDE - 1) * (matrix[:3, 0] + matrix[:3, 1])
    matrix[:3, 3] = tumor_from_tip.translation_mm - middle
    return matrix


def edges(matrix: FloatArray) -> str:
    """Letters of the directions in RAS to the left, right, upper and lower edge of an image."""
    column, row = matrix[:3, 0], matrix[:3, 1]
    return "".join(_letter(each) for each in (-column, column, -row, row))


def _letter(direction: FloatArray) -> str:
    axis = int(np.argmax(np.abs(direction)))
    return "RAS"[axis] if direction[axis] > 0.0 else "LPI"[axis]
