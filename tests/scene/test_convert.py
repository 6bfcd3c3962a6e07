import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from slicer import vtkMRMLScene

from app.scene.convert import numpy_array, poly_data, vtk_matrix, world_matrix, world_points
from tests.scene.conftest import posed

pytestmark = pytest.mark.slow

three = st.tuples(*[st.floats(-3.0, 3.0)] * 3)


@given(three, three)
def test_matrix_keeps_every_number(turn, shift):
    pose = posed("a", "b", turn, shift)
    matrix = vtk_matrix(pose)
    # VTK's own multiplication is the peer: a point goes where our transform takes it.
    assert np.allclose(matrix.MultiplyPoint((1.0, 2.0, 3.0, 1.0))[:3], pose.apply([1.0, 2.0, 3.0]))


def test_surface_keeps_vertices_and_faces(tumor):
    surface = poly_data(tumor)
    assert np.array_equal(numpy_array(surface.GetPoints().GetData()), tumor.vertices_mm)
    cells = numpy_array(surface.GetPolys().GetConnectivityArray()).reshape(-1, 3)
    assert np.array_equal(cells, tumor.faces)
    assert surface.GetNumberOfCells() == len(tumor.faces)


def test_world_matrix_includes_all_parents(tumor):
    scene = vtkMRMLScene()
    outer = posed("ras", "a", [0, 0, 1], [1, 2, 3])
    inner = posed("a", "tumor", [1, 0, 0], [4, 5, 6])
    nodes = [scene.AddNewNodeByClass("vtkMRMLLinearTransformNode") for _ in range(2)]
    nodes[0].SetMatrixTransformToParent(vtk_matrix(outer))
    nodes[1].SetMatrixTransformToParent(vtk_matrix(inner))
    nodes[1].SetAndObserveTransformNodeID(nodes[0].GetID())
    model = scene.AddNewNodeByClass("vtkMRMLModelNode")
    model.SetAndObservePolyData(poly_data(tumor))
    assert np.allclose(world_points(model), tumor.vertices_mm)
    model.SetAndObserveTransformNodeID(nodes[1].GetID())
    assert np.allclose(world_points(model), (outer @ inner).apply(tumor.vertices_mm))
    assert np.allclose(world_matrix(nodes[1]), (outer @ inner).matrix)
    assert np.array_equal(world_matrix(None), np.eye(4))
