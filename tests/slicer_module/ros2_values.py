"""Values of Slicer in the tests of the ROS2 module, and the robot that the peer describes."""

from typing import Any

import numpy as np
import vtk
from numpy.typing import ArrayLike
from vtkmodules.util.numpy_support import vtk_to_numpy

URDF = """<robot name="arm">
  <link name="base"><visual><geometry><box size="0.2 0.2 0.1"/></geometry>
    <material name="blue"><color rgba="0.1 0.2 0.6 1"/></material></visual></link>
  <link name="wrist"/>
  <link name="tip"><visual><origin xyz="0 0 0.05"/><geometry><box size="0.02 0.02 0.1"/></geometry>
    <material name="red"><color rgba="1 0 0 1"/></material></visual></link>
  <joint name="turn" type="revolute"><parent link="base"/><child link="wrist"/>
    <origin xyz="0 0 0.1"/><axis xyz="0 0 1"/>
    <limit lower="-3" upper="3" effort="1" velocity="1"/></joint>
  <joint name="end" type="fixed"><parent link="wrist"/><child link="tip"/>
    <origin xyz="0.3 0 0"/></joint>
</robot>"""


def matrix(rows: ArrayLike, translation: ArrayLike | None = None) -> vtk.vtkMatrix4x4:
    """Matrix of 4 rows of 4 numbers, of 3 such rows, or of 3 rows of 3 and a translation."""
    full = np.eye(4)
    given = np.asarray(rows, dtype=float)
    full[: given.shape[0], : given.shape[1]] = given
    if translation is not None:
        full[:3, 3] = translation
    made = vtk.vtkMatrix4x4()
    made.DeepCopy(full.ravel())
    return made


def shifted(x_mm: float = 0.0, y_mm: float = 0.0, z_mm: float = 0.0) -> vtk.vtkMatrix4x4:
    return matrix(np.eye(3), [x_mm, y_mm, z_mm])


def rows(value: vtk.vtkMatrix4x4) -> np.ndarray:
    return np.array([[value.GetElement(r, c) for c in range(4)] for r in range(4)])


def translation(value: vtk.vtkMatrix4x4) -> list[float]:
    return rows(value)[:3, 3].tolist()


def x_mm(node: Any) -> float:
    """The x of a transform node in its parent."""
    found = vtk.vtkMatrix4x4()
    node.GetMatrixTransformToParent(found)
    return found.GetElement(0, 3)


def array_of(kind: type, values: ArrayLike) -> Any:
    made = kind()
    for value in values:
        made.InsertNextValue(value)
    return made


def ints(*values: int) -> vtk.vtkIntArray:
    return array_of(vtk.vtkIntArray, values)


def doubles(*values: float) -> vtk.vtkDoubleArray:
    return array_of(vtk.vtkDoubleArray, values)


def table(*columns: Any) -> vtk.vtkTable:
    made = vtk.vtkTable()
    for name, column in zip("ab", columns, strict=True):
        column.SetName(name)
        made.AddColumn(column)
    return made


def flat(value: Any) -> list[float]:
    return vtk_to_numpy(value).ravel().tolist()


def columns(value: vtk.vtkTable) -> list[list[float]]:
    return [flat(value.GetColumn(n)) for n in range(value.GetNumberOfColumns())]
