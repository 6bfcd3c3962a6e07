"""Surfaces in the plane of an image: the lines in which it cuts tumour, margin, tool, needle."""

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkCommonDataModel import vtkPlane, vtkPolyData
from vtkmodules.vtkFiltersCore import vtkCutter, vtkStripper

from app.geometry import FloatArray, FrameError, ImageSample, SurfaceMesh, Transform, poses_in
from app.scene.convert import poly_data
from app.viewer.steps.view_state import ViewState

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
    needle: Lines = ()
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
    """Adds the lines of tumour, stop margin, tool and needle. Keeps the converted surfaces."""

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
            needle=self._needle(view, shown, root),
            tip=_mapped(to_pixels, tip.translation_mm[None])[0],
            closest=closest,
        )

    def _needle(self, view: ImageView, shown: ViewState, root: str) -> Lines:
        """The lines of the needle, none while its pose may not be used."""
        needle = shown.content.needle
        if needle is None:
            return ()
        try:
            holder, _ = shown.step.edges.between(root, needle.frame_from_tip.target)
        except FrameError:
            return ()
        to_pixels = pixels_from_root(view.matrix) @ (holder @ needle.frame_from_tip).matrix
        return self._cuts.cut(needle.surface, to_pixels)


def root_from_tumor(shown: ViewState, root: str) -> Transform | None:
    """Where the tumour of ``shown`` is in the scene's frame ``root``; None if it is not known."""
    poses, frame = poses_in(root, shown.measured), shown.content.tumor.frame
    holder = next((each for each in shown.content.static_edges if each.source == frame), None)
    if holder is None or holder.target not in poses:
        return None
    return poses[holder.target] @ holder


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
