"""The tumour that LumpNav builds from contoured points, with VTK's filters.

Independent of `app.case.tumor.surfaces`. Steps as in LumpNav: the convex hull of the points,
three butterfly subdivisions, and the convex hull of the result.
"""

from typing import Any

import numpy as np
import vtk
from scipy.spatial import ConvexHull
from vtkmodules.util.numpy_support import numpy_to_vtk, vtk_to_numpy

from app.geometry import FloatArray


def lumpnav_volume_mm3(points_mm: FloatArray) -> float:
    """Volume of LumpNav's tumour around ``points_mm`` (n, 3)."""
    cloud, points = vtk.vtkPolyData(), vtk.vtkPoints()
    points.SetData(numpy_to_vtk(points_mm, deep=True))
    cloud.SetPoints(points)
    butterfly = vtk.vtkButterflySubdivisionFilter()
    butterfly.SetInputData(_hull(cloud))
    butterfly.SetNumberOfSubdivisions(3)
    butterfly.Update()
    rounded = vtk_to_numpy(_hull(butterfly.GetOutput()).GetPoints().GetData())
    return float(ConvexHull(rounded.astype(np.float64)).volume)


def _hull(data: Any) -> Any:
    delaunay, surface = vtk.vtkDelaunay3D(), vtk.vtkDataSetSurfaceFilter()
    delaunay.SetInputData(data)
    surface.SetInputConnection(delaunay.GetOutputPort())
    surface.Update()
    return surface.GetOutput()
