"""Surfaces in the plane of an image, and cuts of a volume through the tool's tip."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from enum import StrEnum
from itertools import pairwise

import numpy as np
from scipy.ndimage import map_coordinates
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkCommonDataModel import vtkPlane, vtkPolyData
from vtkmodules.vtkFiltersCore import vtkCutter, vtkStripper

from app.files.volume_file import Volume
from app.fixture import MarginState
from app.geometry import (
    FloatArray,
    FrameError,
    ImageSample,
    ImageStatus,
    SurfaceMesh,
    Transform,
    poses_in,
)
from app.scene import SceneError, forward_of
from app.scene.convert import poly_data
from app.viewer.view_state import ViewState

Lines = tuple[FloatArray, ...]
"""Lines of points (n, 2): column and row, 0 at the centre of the first pixel."""


@dataclass(frozen=True, slots=True, eq=False)
class ImageView:
    """One image with the present tool and tumour in it, or why no image may be shown.

    ``image`` and ``matrix``, (4, 4) from (column, row, 0) to mm in the scene's root frame, are None
    exactly if ``problem`` is not empty. The lines are where the image cuts the surfaces; they are
    empty while tool and tumour are not known. ``tip``: column, row and distance in mm of the tool's
    tip from the image's plane. ``closest``: the closest points on tumour and tool in it, (2, 2).
    ``edges``: letters of the anatomical directions to the left, right, upper and lower edge.
    ``depth_mm``: the imaging depth by which it is placed; None for a probe with one, or a cut.
    """

    image: ImageSample | None
    matrix: FloatArray | None
    problem: str
    number: int | None = None
    tumor: Lines = ()
    margin: Lines = ()
    tool: Lines = ()
    items: Mapping[str, Lines] = field(default_factory=dict)
    tip: FloatArray | None = None
    closest: FloatArray | None = None
    edges: str = ""
    depth_mm: float | None = None


class SurfaceCuts:
    """Cuts surfaces by the plane of an image. Keeps the surfaces of the last cuts, converted."""

    def __init__(self) -> None:
        self._surfaces: dict[int, tuple[SurfaceMesh, vtkPolyData]] = {}

    def cut(self, mesh: SurfaceMesh, to_pixels: FloatArray) -> Lines:
        """The lines in which the image's plane cuts ``mesh``; ``to_pixels`` from its frame."""
        known = self._surfaces.get(id(mesh))
        if known is None or known[0] is not mesh:
            if len(self._surfaces) > 8:  # surfaces that an operator has replaced
                self._surfaces.clear()
            known = self._surfaces[id(mesh)] = (mesh, poly_data(mesh))
        plane = vtkPlane()
        # The third row of the map is the distance from the plane: its gradient is the normal.
        normal, distance = to_pixels[2, :3], to_pixels[2, 3]
        plane.SetNormal(normal.tolist())
        plane.SetOrigin((-distance * normal / (normal @ normal)).tolist())
        cutter = vtkCutter()
        cutter.SetCutFunction(plane)
        cutter.SetInputData(known[1])
        joined = vtkStripper()
        joined.SetInputConnection(cutter.GetOutputPort())
        joined.JoinContiguousSegmentsOn()
        joined.Update()
        found = joined.GetOutput()
        if not found.GetNumberOfLines():
            return ()
        points = _mapped(to_pixels, vtk_to_numpy(found.GetPoints().GetData()))[:, :2]
        offsets = vtk_to_numpy(found.GetLines().GetOffsetsArray())
        ids = vtk_to_numpy(found.GetLines().GetConnectivityArray())
        return tuple(points[ids[begin:end]] for begin, end in pairwise(offsets.tolist()))


class PlaneLines:
    """Adds the lines of tumour, stop margin, tool and rods. Keeps the converted surfaces."""

    def __init__(self) -> None:
        self._cuts = SurfaceCuts()

    def added(
        self, view: ImageView, shown: ViewState, root_from_tumor: Transform, tip: Transform
    ) -> ImageView:
        """``view`` with the lines of the step of ``shown``; ``tip`` is the tumour-from-tip pose."""
        root = root_from_tumor.target
        to_pixels = pixels_from_root(view.matrix) @ root_from_tumor.matrix
        content, proximity = shown.content, shown.step.decision.proximity
        margin, tool = shown.margin_surface, content.tool
        closest = None
        if proximity is not None and proximity.is_finite:
            ends = np.array([proximity.on_tumor_mm, proximity.on_tool_mm])
            closest = _mapped(to_pixels, ends)[:, :2]
        return replace(
            view,
            tumor=self._cuts.cut(content.tumor, to_pixels),
            margin=() if margin is None else self._cuts.cut(margin, to_pixels),
            tool=() if tool is None else self._cuts.cut(tool, to_pixels @ tip.matrix),
            items=self._items(view, shown, root),
            tip=_mapped(to_pixels, tip.translation_mm[None])[0],
            closest=closest,
        )

    def _items(self, view: ImageView, shown: ViewState, root: str) -> dict[str, Lines]:
        """The lines of each rod by its name, without those whose pose may not be used."""
        found = {}
        for item in shown.content.items:
            if item.is_pointer or item.surface is None:
                continue
            try:
                holder, _ = shown.step.edges.between(root, item.frame)
            except FrameError:
                continue
            to_pixels = pixels_from_root(view.matrix) @ (holder @ item.tip).matrix
            found[item.name] = self._cuts.cut(item.surface, to_pixels)
        return found


def root_from_tumor(shown: ViewState, root: str) -> Transform | None:
    """Where the tumour of ``shown`` is in the scene's frame ``root``; None if it is not known."""
    poses, holder = poses_in(root, shown.measured), shown.content.frame_from_tumor
    return poses[holder.target] @ holder if holder.target in poses else None


def pixels_from_root(matrix: FloatArray | None) -> FloatArray:
    """Return (4, 4) from mm in the root frame to column, row and distance from the plane in mm.

    ``matrix`` (4, 4) maps (column, row, 0) to mm. The distance is positive on the side of the
    cross product of the directions of columns and rows.
    """
    if matrix is None:
        raise ValueError("the image has no place")
    whole = np.array(matrix)
    normal = np.cross(whole[:3, 0], whole[:3, 1])
    whole[:3, 2] = normal / np.linalg.norm(normal)
    return np.asarray(np.linalg.inv(whole), dtype=np.float64)


def _mapped(matrix: FloatArray, points: FloatArray) -> FloatArray:
    found: FloatArray = points @ matrix[:3, :3].T + matrix[:3, 3]
    return found


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
    """Cuts ``volume``, whose RAS axes are those of the tumour's frame, through the tool's tip.

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
