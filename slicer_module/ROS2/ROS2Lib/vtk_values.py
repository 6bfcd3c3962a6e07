"""Conversions between VTK's arrays, tables, matrices, images and points and plain values."""

from collections.abc import Mapping, Sequence
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray
from vtkmodules.util.numpy_support import get_vtk_array_type, numpy_to_vtk, vtk_to_numpy
from vtkmodules.vtkCommonCore import vtkDataArray, vtkDoubleArray, vtkIntArray, vtkPoints
from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkImageData, vtkPolyData, vtkTable
from vtkmodules.vtkCommonMath import vtkMatrix4x4

from app.geometry import Transform
from app.scene.convert import vtk_matrix
from ROS2Lib.member import Ros2Error

Plain = Mapping[str, Any]
Array = TypeVar("Array", bound=vtkDataArray)

_INT32 = np.iinfo(np.int32)


def matrix(translation: Plain, rotation: Plain) -> vtkMatrix4x4:
    """Matrix of a pose in mm; raises `TransformError` for an invalid quaternion."""
    pose = Transform.from_quaternion(
        [rotation[axis] for axis in "xyzw"],
        [translation[axis] for axis in "xyz"],
        target="parent",
        source="child",
    )
    return vtk_matrix(pose)


def transform(value: vtkMatrix4x4, parent: str = "parent", child: str = "child") -> Transform:
    """``parent_from_child`` of a matrix in mm; raises `TransformError` if it is not rigid."""
    if not isinstance(value, vtkMatrix4x4):
        raise Ros2Error(f"pose is a {type(value).__name__}; expected a vtkMatrix4x4")
    rows = [[value.GetElement(row, column) for column in range(4)] for row in range(4)]
    return Transform.from_matrix(rows, target=parent, source=child)


def translation_and_rotation(value: vtkMatrix4x4) -> tuple[dict[str, float], dict[str, float]]:
    """Translation in mm and quaternion of a matrix, by field name."""
    pose = transform(value)
    return (
        dict(zip("xyz", pose.translation_mm.tolist(), strict=True)),
        dict(zip("xyzw", pose.quaternion_xyzw.tolist(), strict=True)),
    )


def array(values: NDArray[Any] | Sequence[float], kind: type[Array]) -> Array:
    """VTK array of class ``kind`` with the values (n,).

    Raises `Ros2Error` for an integer beyond the 32 bits of a vtkIntArray.
    """
    given = np.asarray(values)
    if kind is vtkIntArray and given.size:
        low, high = int(given.min()), int(given.max())
        if low < _INT32.min or high > _INT32.max:
            raise Ros2Error(
                f"integers from {low} to {high} do not fit a vtkIntArray; expected at most 32 bits"
            )
    found = kind()
    found.SetNumberOfValues(len(given))
    if given.size:
        vtk_to_numpy(found)[:] = given
    return found


def numbers(value: vtkDataArray) -> NDArray[Any]:
    """Values (n,) of an array; tuples of several components are flattened."""
    if not isinstance(value, vtkDataArray):
        raise Ros2Error(f"value is a {type(value).__name__}; expected a vtkDataArray")
    return np.asarray(vtk_to_numpy(value)).reshape(-1)


def six_array(first: Plain, second: Plain) -> vtkDoubleArray:
    """Two vectors as one array of six values: SlicerROS2's form of wrenches and twists."""
    return array([part[axis] for part in (first, second) for axis in "xyz"], vtkDoubleArray)


def two_vectors(value: vtkDataArray) -> tuple[dict[str, float], dict[str, float]]:
    """The two vectors of an array of six values."""
    found = numbers(value).tolist()
    if len(found) != 6:
        raise Ros2Error(f"two vectors have {len(found)} values; expected 6")
    return (
        dict(zip("xyz", map(float, found[:3]), strict=True)),
        dict(zip("xyz", map(float, found[3:]), strict=True)),
    )


def table(plain: Plain, kind: type[vtkDataArray]) -> vtkTable:
    """Table of a row-major MultiArray of at most two dimensions; one column without a second."""
    sizes = [dimension["size"] for dimension in plain["layout"]["dim"]] or [len(plain["data"])]
    if len(sizes) > 2:
        raise Ros2Error(f"multi-array has {len(sizes)} dimensions; expected at most 2 for a table")
    rows, columns = (*sizes, 1)[:2]
    begin = plain["layout"]["data_offset"]
    data = np.asarray(plain["data"])[begin:]
    if rows * columns != data.size:
        raise Ros2Error(
            f"a table of {rows} x {columns} has {data.size} values; expected {rows * columns}"
        )
    found = vtkTable()
    for index, column in enumerate(data.reshape(rows, columns).T):
        values = array(column, kind)
        values.SetName(f"{index}")
        found.AddColumn(values)
    return found


def multi_array(value: vtkTable) -> dict[str, Any]:
    """Row-major MultiArray of a table, with strides as `MultiArrayLayout` defines them."""
    if not isinstance(value, vtkTable):
        raise Ros2Error(f"value is a {type(value).__name__}; expected a vtkTable")
    rows, columns = value.GetNumberOfRows(), value.GetNumberOfColumns()
    data = [value.GetColumn(index) for index in range(columns)]
    values = np.stack([numbers(column) for column in data], axis=1) if data else np.empty((0, 0))
    dimensions = [
        {"label": "x", "size": rows, "stride": rows * columns},
        {"label": "y", "size": columns, "stride": columns},
    ]
    return {"layout": {"dim": dimensions}, "data": values.reshape(-1)}


def image(pixels: NDArray[Any]) -> vtkImageData:
    """Image of pixels (rows, columns) or (rows, columns, components); the first row is j = 0."""
    rows, columns = pixels.shape[:2]
    scalars = np.ascontiguousarray(pixels).reshape(rows * columns, -1)
    found = vtkImageData()
    found.SetDimensions(columns, rows, 1)
    found.GetPointData().SetScalars(
        numpy_to_vtk(scalars, deep=True, array_type=get_vtk_array_type(scalars.dtype))
    )
    return found


def pixels(value: vtkImageData) -> NDArray[Any]:
    """Pixels of a single slice, in the shape of `image`."""
    if not isinstance(value, vtkImageData):
        raise Ros2Error(f"value is a {type(value).__name__}; expected a vtkImageData")
    columns, rows, slices = value.GetDimensions()
    scalars = value.GetPointData().GetScalars()
    if slices != 1 or scalars is None:
        raise Ros2Error(f"image is {columns} x {rows} x {slices}; expected one slice with pixels")
    shape = (rows, columns, scalars.GetNumberOfComponents())
    found = np.asarray(vtk_to_numpy(scalars)).reshape(shape)
    return found[:, :, 0] if shape[2] == 1 else found


def points(positions_mm: NDArray[np.float64]) -> vtkPoints:
    """VTK points of positions (n, 3) in mm."""
    found = vtkPoints()
    found.SetData(numpy_to_vtk(np.ascontiguousarray(positions_mm, dtype=np.float64), deep=True))
    return found


def positions_mm(value: vtkPoints | vtkPolyData) -> NDArray[np.float64]:
    """Positions (n, 3) in mm."""
    found = value.GetPoints() if isinstance(value, vtkPolyData) else value
    if found is None:
        return np.empty((0, 3))
    if not isinstance(found, vtkPoints):
        raise Ros2Error(f"value is a {type(value).__name__}; expected vtkPoints or vtkPolyData")
    return np.asarray(vtk_to_numpy(found.GetData()), dtype=np.float64).reshape(-1, 3)


def cloud(positions: NDArray[np.float64]) -> vtkPolyData:
    """Visible points (n, 3), each with a vertex; points that are not finite are left out."""
    finite = positions[np.isfinite(positions).all(axis=1)]
    vertices = vtkCellArray()
    vertices.SetData(
        numpy_to_vtk(np.arange(len(finite) + 1, dtype=np.int64), deep=True),
        numpy_to_vtk(np.arange(len(finite), dtype=np.int64), deep=True),
    )
    found = vtkPolyData()
    found.SetPoints(points(finite))
    found.SetVerts(vertices)
    return found


def set_output(target: Any, value: Any) -> bool:
    """Copy ``value`` into ``target``; False, and nothing is copied, if ``value`` is None.

    ``target`` is a `vtk.reference` for a number or a string, or a VTK object of the class of
    ``value``. Raises `Ros2Error` for any other.
    """
    if value is None:
        return False
    if hasattr(target, "set") and hasattr(target, "get"):
        target.set(value)
    elif hasattr(target, "DeepCopy") and target.IsA(value.GetClassName()):
        target.DeepCopy(value)
    else:
        raise Ros2Error(
            f"output argument is {type(target).__name__}; expected a vtk.reference or "
            f"{type(value).__name__}"
        )
    return True
