import numpy as np
import pytest
import trimesh
from slicer import vtkMRMLMarkupsFiducialNode, vtkOrientedImageData
from vtkmodules.vtkCommonDataModel import vtkPolyData
from vtkmodules.vtkCommonMath import vtkMatrix4x4

from app.geometry import SurfaceMesh
from app.scene import SceneError, mesh_of_model, mesh_of_segment, points_of_markups
from app.scene.convert import poly_data, vtk_array, vtk_matrix
from tests.scene.conftest import posed

pytestmark = pytest.mark.slow

RAS_FROM_OUTER = posed("ras", "outer", [0.9, 0.0, 0.4], [7.0, -8.0, 9.0])
OUTER_FROM_INNER = posed("outer", "inner", [0.0, 1.4, 0.4], [70.0, 8.0, 0.5])
RAS_FROM_NEEDLE = posed("ras", "needle", [2.0, 0.4, 0.4], [1.0, 2.0, -50.0])


def hang(application, *poses):
    """A chain of transform nodes, the outermost first; the innermost."""
    parent = None
    for pose in poses:
        node = application.scene.AddNewNodeByClass("vtkMRMLLinearTransformNode")
        matrix = pose if isinstance(pose, vtkMatrix4x4) else vtk_matrix(pose)
        node.SetMatrixTransformToParent(matrix)
        node.SetAndObserveTransformNodeID(parent.GetID() if parent else None)
        parent = node
    return parent


def model_of(application, surface):
    model = application.scene.AddNewNodeByClass("vtkMRMLModelNode", "Lesion")
    model.SetAndObservePolyData(surface)
    return model


def as_set(points):
    """Rows in sorted order, so that two point sets can be compared."""
    rounded = np.round(points, 4)
    return points[np.lexsort(rounded.T)]


def test_model_is_transformed_through_its_parents_into_a_frame(application, tumor):
    model = model_of(application, poly_data(tumor))
    parent = hang(application, RAS_FROM_OUTER, OUTER_FROM_INNER)
    model.SetAndObserveTransformNodeID(parent.GetID())
    needle = hang(application, RAS_FROM_NEEDLE)
    mesh = mesh_of_model(model, "needle", needle).require_closed("the lesion")
    needle_from_inner = (RAS_FROM_NEEDLE.inverse() @ RAS_FROM_OUTER @ OUTER_FROM_INNER).apply
    assert mesh.frame == "needle"
    assert np.allclose(
        as_set(mesh.vertices_mm), as_set(needle_from_inner(tumor.vertices_mm)), atol=1e-9
    )
    assert mesh.signed_volume_mm3 == pytest.approx(tumor.signed_volume_mm3)
    # Without a frame's node: the world.
    world = mesh_of_model(model, "ras", None)
    expected = (RAS_FROM_OUTER @ OUTER_FROM_INNER).apply(tumor.vertices_mm)
    assert np.allclose(as_set(world.vertices_mm), as_set(expected), atol=1e-9)


def test_reflected_model_keeps_its_normals_outward(application, tumor):
    mirror = vtkMatrix4x4()
    mirror.SetElement(0, 0, -1.0)
    model = model_of(application, poly_data(tumor))
    model.SetAndObserveTransformNodeID(hang(application, mirror).GetID())
    mesh = mesh_of_model(model, "ras", None).require_closed("the lesion")
    assert np.allclose(
        as_set(mesh.vertices_mm), as_set(tumor.vertices_mm * [-1.0, 1.0, 1.0]), atol=1e-9
    )


def test_equal_vertices_are_merged(application, tumor):
    soup = SurfaceMesh(
        "tumor", tumor.triangles_mm.reshape(-1, 3), np.arange(3 * len(tumor.faces)).reshape(-1, 3)
    )
    assert soup.open_edges() > 0
    mesh = mesh_of_model(model_of(application, poly_data(soup)), "tumor", None)
    assert mesh.require_closed("the lesion").vertices_mm.shape == tumor.vertices_mm.shape


def test_model_saved_in_lps_has_its_pose(application, tumor, tmp_path):
    """A file in LPS, written by Slicer's own storage node and read by a library that keeps it."""
    path = tmp_path / "lesion.ply"
    model = model_of(
        application, poly_data(tumor.transformed(OUTER_FROM_INNER.renamed(source="tumor")))
    )
    storage = application.scene.AddNewNodeByClass("vtkMRMLModelStorageNode")
    storage.SetFileName(str(path))
    assert storage.WriteData(model)
    in_file = np.asarray(trimesh.load(path, process=False).vertices)
    again = application.scene.AddNewNodeByClass("vtkMRMLModelNode")
    assert storage.ReadData(again)
    mesh = mesh_of_model(again, "ras", None)
    assert np.allclose(as_set(mesh.vertices_mm), as_set(in_file * [-1.0, -1.0, 1.0]), atol=1e-3)
    assert np.allclose(
        as_set(mesh.vertices_mm), as_set(OUTER_FROM_INNER.apply(tumor.vertices_mm)), atol=1e-3
    )


def test_model_without_a_triangle_is_refused(application):
    with pytest.raises(SceneError, match="model 'Lesion': 0 triangles; expected a surface"):
        mesh_of_model(model_of(application, vtkPolyData()), "ras", None)


VOXEL_MM, RADIUS_MM = 0.5, 6.0
CENTRE_MM = np.array([16.0, 27.5, 39.0])


@pytest.fixture
def segmentation(application):
    """A ball of voxels called ``lesion``, and an empty segment."""
    node = application.scene.AddNewNodeByClass("vtkMRMLSegmentationNode", "Seg")
    origin = np.array([8.0, 18.0, 30.0])
    z, y, x = np.mgrid[:36, :36, :36]
    points = origin + VOXEL_MM * np.stack([x, y, z], axis=-1)
    ball = np.linalg.norm(points - CENTRE_MM, axis=-1) <= RADIUS_MM
    for name, marks in (("lesion", ball), ("nothing", np.zeros_like(ball))):
        image = vtkOrientedImageData()
        image.SetDimensions(36, 36, 36)
        image.SetSpacing(VOXEL_MM, VOXEL_MM, VOXEL_MM)
        image.SetOrigin(origin.tolist())
        image.GetPointData().SetScalars(vtk_array(marks.astype(np.uint8).ravel()))
        node.AddSegmentFromBinaryLabelmapRepresentation(image, name, [1.0, 0.0, 0.0])
    return node


def test_segment_becomes_a_closed_surface_in_a_frame(application, segmentation):
    segmentation.SetAndObserveTransformNodeID(hang(application, RAS_FROM_OUTER).GetID())
    needle = hang(application, RAS_FROM_NEEDLE)
    mesh = mesh_of_segment(segmentation, "lesion", "needle", needle).require_closed("the lesion")
    centre = (RAS_FROM_NEEDLE.inverse() @ RAS_FROM_OUTER).apply(CENTRE_MM)
    from_centre = np.linalg.norm(mesh.vertices_mm - centre, axis=1)
    assert np.abs(from_centre - RADIUS_MM).max() < VOXEL_MM
    assert from_centre.mean() == pytest.approx(RADIUS_MM, abs=0.2 * VOXEL_MM)


@pytest.mark.parametrize(
    ("name", "words"),
    [("tumour", "'Seg': 0 segments are named 'tumour'; expected 1 among lesion, nothing"),
     ("nothing", "segment 'nothing' of 'Seg' has no surface")],
)  # fmt: skip
def test_unknown_or_empty_segment_is_refused(segmentation, name, words):
    with pytest.raises(SceneError, match=words):
        mesh_of_segment(segmentation, name, "ras", None)


def test_placed_points_are_transformed_through_their_parents_into_a_frame(application):
    points = np.random.default_rng(1).normal(scale=20.0, size=(7, 3))
    markups: vtkMRMLMarkupsFiducialNode = application.scene.AddNewNodeByClass(
        "vtkMRMLMarkupsFiducialNode", "Contour"
    )
    assert points_of_markups(markups, None).shape == (0, 3)
    for point in points:
        markups.AddControlPoint(point.tolist())
    markups.UnsetNthControlPointPosition(markups.AddControlPoint([0.0, 0.0, 0.0]))
    markups.SetAndObserveTransformNodeID(hang(application, RAS_FROM_OUTER).GetID())
    found = points_of_markups(markups, hang(application, RAS_FROM_NEEDLE))
    expected = (RAS_FROM_NEEDLE.inverse() @ RAS_FROM_OUTER).apply(points)
    assert np.allclose(found, expected, atol=1e-9)
