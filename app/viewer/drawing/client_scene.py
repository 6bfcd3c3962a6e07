"""The scene as values for the page, which draws it with vtk.js (`--render client`).

A surface is sent once, then where it is and how it looks. All of it is read from the MRML nodes
that the server draws otherwise, so both show the same state.
"""

import base64
from collections.abc import Iterator, Sequence
from enum import StrEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray
from slicer import vtkMRMLMarkupsLineNode, vtkMRMLMarkupsPlaneNode, vtkMRMLModelNode
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkCommonDataModel import vtkPolyData

from app.geometry import FloatArray
from app.scene import MarginGuardScene
from app.scene.convert import world_matrix
from app.viewer.drawing.scene_view import SceneView

Values = dict[str, Any]


def encoded(values: NDArray[np.generic]) -> Values:
    """The values of an array of float32, uint32 or uint8 as trame-vtk's components take them."""
    text = base64.b64encode(np.ascontiguousarray(values).tobytes()).decode("ascii")
    return {"bvals": text, "dtype": str(values.dtype), "shape": [int(values.size)]}


_SIDES, _RINGS = 12, 7


class Shape(StrEnum):
    """A surface that the page draws besides the models: of size 1, placed by a matrix."""

    BALL = "ball"
    """Radius 1 around the origin."""
    ROD = "rod"
    """Radius 1 around z, from 0 to 1."""
    PLANE = "square"
    """Sides of 1 in x and y around the origin."""


def shape_surface(shape: Shape) -> Values:
    """The points, faces and normals of ``shape``, encoded for the page."""
    if shape is Shape.PLANE:
        corners = np.array([[-0.5, -0.5, 0], [0.5, -0.5, 0], [0.5, 0.5, 0], [-0.5, 0.5, 0]])
        return _encoded_surface(corners, [[0, 1, 2], [0, 2, 3]], np.tile([0.0, 0.0, 1.0], (4, 1)))
    if shape is Shape.ROD:
        ring = _ring()
        points = np.concatenate([ring, ring + _along_z(1.0)])
        return _encoded_surface(points, _bands(2), np.concatenate([ring, ring]))
    polar = np.linspace(0.0, np.pi, _RINGS)
    rings = [_ring() * np.sin(a) + _along_z(np.cos(a)) for a in polar]
    points = np.concatenate(rings)
    return _encoded_surface(points, _bands(_RINGS), points)


def _along_z(height: float) -> FloatArray:
    return np.array([0.0, 0.0, height])


def _ring() -> FloatArray:
    turn = np.linspace(0.0, 2.0 * np.pi, _SIDES, endpoint=False)
    return np.column_stack([np.cos(turn), np.sin(turn), np.zeros(_SIDES)])


def _bands(rings: int) -> list[list[int]]:
    """The triangles between rings of points, one ring after the other."""
    faces = []
    for ring in range(rings - 1):
        for side in range(_SIDES):
            a, b = ring * _SIDES + side, ring * _SIDES + (side + 1) % _SIDES
            faces += [[a, b, b + _SIDES], [a, b + _SIDES, a + _SIDES]]
    return faces


def _encoded_surface(points: FloatArray, faces: list[list[int]], normals: FloatArray) -> Values:
    return {
        "points": encoded(points.astype(np.float32)),
        "polys": encoded(np.array([[3, *face] for face in faces], np.uint32)),
        "normals": encoded(normals.astype(np.float32)),
        "colors": None,
    }


_COLORS = "color"
_LIT = {"ambient": 0.3, "diffuse": 0.75, "specular": 0.15, "specularPower": 20.0}
_DIRECT = {"colorMode": 2, "scalarMode": 2}
"""vtk.js: the colours of the faces are colours, not values that a table turns into colours."""
_BALL_MM, _ROD_MM = 0.45, 0.175
"""Radii of the closest points and of the line between them."""
_OTHER_SIDE = (0.02, 0.02, 0.02)
"""Colour of the constraint's plane on the side that is not allowed, as Slicer draws it."""
_MAX_MARKS = 200
"""Breach marks that the page draws: the last ones."""


class ClientScene:
    """Describes the scene of ``view``. Call it in the page's thread."""

    def __init__(self, view: SceneView) -> None:
        self._view = view
        self._sent: dict[str, int] = {}

    def new_surfaces(self) -> dict[str, object]:
        """All surfaces by name, if any of them has changed since the last call; else empty."""
        scene = self._view.scene
        models = {} if scene is None else dict(self._models(scene))
        times = {name: model.GetPolyData().GetMTime() for name, model in models.items()}
        if times == self._sent:
            return {}
        self._sent = times
        surfaces: dict[str, Values] = {
            name: _surface(model.GetPolyData()) for name, model in models.items()
        }
        return {"surfaces": {**surfaces, **{each.value: shape_surface(each) for each in Shape}}}

    def drawn(self) -> list[Values]:
        """The parts that are drawn now, each with the ``surface`` that it shows, in RAS mm."""
        scene = self._view.scene
        if scene is None:
            return []
        drawn = [_model(name, model) for name, model in self._models(scene)]
        if scene.margin is not None:
            drawn += _line(scene.margin.line)
            drawn += _plane(scene.margin.plane.node)
            display = scene.margin.breaches.node.GetDisplayNode()
            look = (display.GetSelectedColor(), 1.0, bool(display.GetVisibility()))
            marks = scene.margin.breaches.node
            radius_mm = 0.5 * scene.margin.breaches.style.size_mm
            count = marks.GetNumberOfControlPoints()
            points = [
                marks.GetNthControlPointPositionWorld(n)
                for n in range(max(0, count - _MAX_MARKS), count)
            ]
            drawn += [
                _part(f"mark{n}", Shape.BALL, _scaled(radius_mm, point), *look)
                for n, point in enumerate(points)
            ]
        return drawn

    def _models(self, scene: MarginGuardScene) -> Iterator[tuple[str, vtkMRMLModelNode]]:
        yield from _models(scene)
        for part, models in self._view.added.items():
            for name, model in models.items():
                yield f"{part}/{name}", model

    def camera(self) -> Values:
        """The camera of the view, for vtk.js."""
        camera = self._view.view.renderer().GetActiveCamera()
        return {
            "position": list(camera.GetPosition()),
            "focalPoint": list(camera.GetFocalPoint()),
            "viewUp": list(camera.GetViewUp()),
            "viewAngle": camera.GetViewAngle(),
            "centerOfRotation": list(camera.GetFocalPoint()),
        }


def _models(scene: MarginGuardScene) -> Iterator[tuple[str, vtkMRMLModelNode]]:
    for name, model in (
        ("tumor", scene.tumor),
        ("margin", scene.margin_surface),
        ("tool", scene.tool),
        *scene.items.nodes.items(),
        *((f"structure/{name}", node) for name, node in scene.structures.nodes.items()),
    ):
        if model is not None:
            yield name, model
    for robot_name, robot in scene.robots.items():
        for link, model in robot.models.items():
            yield f"{robot_name}/{link}", model


def _model(name: str, model: vtkMRMLModelNode) -> Values:
    display = model.GetDisplayNode()
    parent = model.GetParentTransformNode()
    matrix = np.eye(4) if parent is None else world_matrix(parent)
    part = _part(
        name, name, matrix, display.GetColor(), display.GetOpacity(), bool(display.GetVisibility())
    )
    # A link's own colours; grey, the display's colour, while its pose is unknown.
    return {**part, "mapper": {"scalarVisibility": bool(display.GetScalarVisibility()), **_DIRECT}}


def _line(node: vtkMRMLMarkupsLineNode) -> list[Values]:
    display = node.GetDisplayNode()
    look = (display.GetSelectedColor(), 1.0, bool(display.GetVisibility()))
    if node.GetNumberOfControlPoints() < 2:
        return []
    ends = [np.array(node.GetNthControlPointPositionWorld(n)) for n in range(2)]
    balls = [
        _part(f"end{n}", Shape.BALL, _scaled(_BALL_MM, end), *look) for n, end in enumerate(ends)
    ]
    return [*balls, _part("line", Shape.ROD, _between(ends[0], ends[1]), *look)]


def _plane(node: vtkMRMLMarkupsPlaneNode) -> list[Values]:
    display = node.GetDisplayNode()
    x, y, z = ([0.0] * 3 for _ in range(3))
    node.GetAxesWorld(x, y, z)
    width, height = node.GetSize()
    matrix = np.eye(4)
    matrix[:3, :3] = np.column_stack([np.multiply(x, width), np.multiply(y, height), z])
    matrix[:3, 3] = node.GetCenterWorld()
    opacity = display.GetOpacity() * display.GetFillOpacity()
    visible = bool(display.GetVisibility())
    allowed, other = (
        _part(name, Shape.PLANE, matrix, color, opacity, visible)
        for name, color in (("allowed side", display.GetSelectedColor()), ("side", _OTHER_SIDE))
    )
    allowed["property"] |= {"backfaceCulling": True}
    other["property"] |= {"frontfaceCulling": True}
    return [allowed, other]


def _part(
    name: str,
    surface: str,
    matrix: FloatArray,
    color: Sequence[float],
    opacity: float,
    visible: bool,
) -> Values:
    return {
        "name": name,
        "surface": surface,
        "actor": {
            # vtk.js stores columns.
            "userMatrix": [round(float(value), 4) for value in matrix.T.ravel()],
            "visibility": visible and opacity > 0.0,
        },
        "property": {"color": list(color), "opacity": opacity, **_LIT},
        "mapper": {"scalarVisibility": False},
    }


def _scaled(radius_mm: float, center: Sequence[float] | FloatArray) -> FloatArray:
    matrix = np.diag([radius_mm, radius_mm, radius_mm, 1.0])
    matrix[:3, 3] = center
    return matrix


def _between(first: FloatArray, second: FloatArray) -> FloatArray:
    """The matrix that puts a rod of length 1 along z from ``first`` to ``second``, (3,) in mm."""
    axis = second - first
    length = float(np.linalg.norm(axis))
    along = axis / length if length > 0.0 else np.array([0.0, 0.0, 1.0])
    side = np.cross(along, np.eye(3)[int(np.argmin(np.abs(along)))])
    side /= np.linalg.norm(side)
    matrix = np.eye(4)
    matrix[:3, 0], matrix[:3, 1] = _ROD_MM * side, _ROD_MM * np.cross(along, side)
    matrix[:3, 2], matrix[:3, 3] = max(length, 1e-3) * along, first
    return matrix


def _surface(surface: vtkPolyData) -> Values:
    normals = surface.GetPointData().GetNormals()
    colors = surface.GetCellData().GetArray(_COLORS)
    faces = vtk_to_numpy(surface.GetPolys().GetConnectivityArray()).reshape(-1, 3)
    return {
        "points": encoded(vtk_to_numpy(surface.GetPoints().GetData()).astype(np.float32)),
        "polys": encoded(np.insert(faces, 0, 3, axis=1).astype(np.uint32)),
        "normals": None if normals is None else encoded(vtk_to_numpy(normals).astype(np.float32)),
        "colors": None if colors is None else encoded(vtk_to_numpy(colors)[:, :3]),
    }
