"""VTK's arrays, tables, matrices, images and points to plain values of ours, and back."""

from collections.abc import Mapping, Sequence
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray
from vtkmodules.util.numpy_support import get_vtk_array_type, numpy_to_vtk, vtk_to_numpy
from vtkmodules.vtkCommonCore import vtkDataArray, vtkDoubleArray, vtkIntArray, vtkPoints
from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkImageData, vtkPolyData, vtkTable
from vtkmodules.vtkCommonMath import vtkMatrix4x4

from app.geometry import Transform
from app.scene.nodes.convert import vtk_matrix
from ROS2Lib.errors import Ros2Error

Plain = Mapping[str, Any]
Array = TypeVar("Array", bound=vtkDataArray)

_INT32 = np.iinfo(np.int32)


def matrix(translation: Plain, rotation: Plain) -> vtkMatrix4x4:
    """A pose in mm; raises `TransformError` for a quaternion that is no rotation."""
    pose = Transform.from_quaternion(
        [rotation[axis] for axis in "xyzw"],
        [translation[axis] for axis in "xyz"],
        target="parent",
        source="child",
    )
    return vtk_matrix(pose)


def transform(value: vtkMatrix4x4, parent: str = "parent", child: str = "child") -> Transform:
    """``parent_from_child`` of a matrix in mm; raises `TransformError` when it is not rigid."""
    if not isinstance(value, vtkMatrix4x4):
        raise Ros2Error(f"a {type(value).__name__} is no pose: a vtkMatrix4x4 wanted")
    rows = [[value.GetElement(row, column) for column in range(4)] for row in range(4)]
    return Transform.from_matrix(rows, target=parent, source=child)


def translation_and_rotation(value: vtkMatrix4x4) -> tuple[dict[str, float], dict[str, float]]:
    """A matrix as translation in mm and quaternion, field by field."""
    pose = transform(value)
    return (
        dict(zip("xyz", pose.translation_mm.tolist(), strict=True)),
        dict(zip("xyzw", pose.quaternion_xyzw.tolist(), strict=True)),
    )


def array(values: NDArray[Any] | Sequence[float], kind: type[Array]) -> Array:
    """``kind`` of the values (n,): vtkIntArray or vtkDoubleArray.

    Raises `Ros2Error` for an integer that has no place in VTK's 32 bits.
    """
    given = np.asarray(values)
    if kind is vtkIntArray and given.size:
        low, high = int(given.min()), int(given.max())
        if low < _INT32.min or high > _INT32.max:
            raise Ros2Error(
                f"integers from {low} to {high} do not fit a vtkIntArray: 32 bits allowed"
            )
    found = kind()
    found.SetNumberOfValues(len(given))
    if given.size:
        vtk_to_numpy(found)[:] = given
    return found


def numbers(value: vtkDataArray) -> NDArray[Any]:
    """The values (n,) of an array; a row of several components gives them one after another."""
    if not isinstance(value, vtkDataArray):
        raise Ros2Error(f"a {type(value).__name__} is no array: a vtkDataArray wanted")
    return np.asarray(vtk_to_numpy(value)).reshape(-1)


def six(first: Plain, second: Plain) -> vtkDoubleArray:
    """Two vectors as one array of six, as SlicerROS2 has wrenches and twists."""
    return array([part[axis] for part in (first, second) for axis in "xyz"], vtkDoubleArray)


def two_vectors(value: vtkDataArray) -> tuple[dict[str, float], dict[str, float]]:
    """The two vectors of such an array."""
    found = numbers(value).tolist()
    if len(found) != 6:
        raise Ros2Error(f"an array of {len(found)} values for two vectors: 6 wanted")
    return (
        dict(zip("xyz", map(float, found[:3]), strict=True)),
        dict(zip("xyz", map(float, found[3:]), strict=True)),
    )


def table(plain: Plain, kind: type[vtkDataArray]) -> vtkTable:
    """A MultiArray of two dimensions, row by row; one without a second has one column."""
    sizes = [dimension["size"] for dimension in plain["layout"]["dim"]] or [len(plain["data"])]
    if len(sizes) > 2:
        raise Ros2Error(f"a multi-array of {len(sizes)} dimensions is no table: 2 allowed")
    rows, columns = (*sizes, 1)[:2]
    begin = plain["layout"]["data_offset"]
    data = np.asarray(plain["data"])[begin:]
    if rows * columns != data.size:
        raise Ros2Error(f"a table of {rows} x {columns} has {data.size} values")
    found = vtkTable()
    for index, column in enumerate(data.reshape(rows, columns).T):
        values = array(column, kind)
        values.SetName(f"{index}")
        found.AddColumn(values)
    return found


def multi_array(value: vtkTable) -> dict[str, Any]:
    """A table as a MultiArray, row by row, with the strides that its definition asks for."""
    if not isinstance(value, vtkTable):
        raise Ros2Error(f"a {type(value).__name__} is no table: a vtkTable wanted")
    rows, columns = value.GetNumberOfRows(), value.GetNumberOfColumns()
    data = [value.GetColumn(index) for index in range(columns)]
    values = np.stack([numbers(column) for column in data], axis=1) if data else np.empty((0, 0))
    dimensions = [
        {"label": "x", "size": rows, "stride": rows * columns},
        {"label": "y", "size": columns, "stride": columns},
    ]
    return {"layout": {"dim": dimensions}, "data": values.reshape(-1)}


def image(pixels: NDArray[Any]) -> vtkImageData:
    """Rows as they are, the first at j = 0: (rows, columns) or (rows, columns, components)."""
    rows, columns = pixels.shape[:2]
    scalars = np.ascontiguousarray(pixels).reshape(rows * columns, -1)
    found = vtkImageData()
    found.SetDimensions(columns, rows, 1)
    found.GetPointData().SetScalars(
        numpy_to_vtk(scalars, deep=True, array_type=get_vtk_array_type(scalars.dtype))
    )
    return found


def pixels(value: vtkImageData) -> NDArray[Any]:
    """The rows of a flat image, as `image` has them."""
    if not isinstance(value, vtkImageData):
        raise Ros2Error(f"a {type(value).__name__} is no image: a vtkImageData wanted")
    columns, rows, slices = value.GetDimensions()
    scalars = value.GetPointData().GetScalars()
    if slices != 1 or scalars is None:
        raise Ros2Error(f"an image of {columns} x {rows} x {slices}: one slice with pixels wanted")
    shape = (rows, columns, scalars.GetNumberOfComponents())
    found = np.asarray(vtk_to_numpy(scalars)).reshape(shape)
    return found[:, :, 0] if shape[2] == 1 else found


def points(positions_mm: NDArray[np.float64]) -> vtkPoints:
    """Points (n, 3) in mm."""
    found = vtkPoints()
    found.SetData(numpy_to_vtk(np.ascontiguousarray(positions_mm, dtype=np.float64), deep=True))
    return found


def positions_mm(value: vtkPoints | vtkPolyData) -> NDArray[np.float64]:
    """Points as (n, 3) in mm."""
    found = value.GetPoints() if isinstance(value, vtkPolyData) else value
    if found is None:
        return np.empty((0, 3))
    if not isinstance(found, vtkPoints):
        raise Ros2Error(f"a {type(value).__name__} has no points: vtkPoints or vtkPolyData wanted")
    return np.asarray(vtk_to_numpy(found.GetData()), dtype=np.float64).reshape(-1, 3)


def cloud(positions: NDArray[np.float64]) -> vtkPolyData:
    """Points (n, 3) that can be seen: each has a vertex. Those that are not finite are left out."""
    seen = positions[np.isfinite(positions).all(axis=1)]
    vertices = vtkCellArray()
    vertices.SetData(
        numpy_to_vtk(np.arange(len(seen) + 1, dtype=np.int64), deep=True),
        numpy_to_vtk(np.arange(len(seen), dtype=np.int64), deep=True),
    )
    found = vtkPolyData()
    found.SetPoints(points(seen))
    found.SetVerts(vertices)
    return found
