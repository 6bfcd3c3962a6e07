from pathlib import Path

import numpy as np
import pytest
import trimesh
from slicer import (
    vtkMRMLMarkupsFiducialNode,
    vtkMRMLModelNode,
    vtkMRMLScene,
    vtkMRMLTransformNode,
    vtkOrientedImageData,
)
from vtkmodules.vtkCommonDataModel import vtkPolyData
from vtkmodules.vtkCommonMath import vtkMatrix4x4

from app.geometry import MarginGuardError, SurfaceMesh, Transform, TransformError
from app.scene import (
    EditedTransform,
    MarginGuardScene,
    SceneApplication,
    SceneError,
    mesh_of_model,
    mesh_of_segment,
    points_of_markups,
)
from app.scene.nodes.convert import poly_data, vtk_array, vtk_matrix

NEEDLE = Transform.from_rotation_vector(
    [0.1, 0.2, 0.3], [10.0, 20.0, 30.0], target="reference", source="needle"
)
BY_HAND = Transform.from_rotation_vector(
    [0.5, -0.2, 0.1], [-4.0, 5.0, 6.0], target="reference", source="needle"
)
RAS_FROM_OUTER = Transform.from_rotation_vector(
    [0.9, 0.0, 0.4], [7.0, -8.0, 9.0], target="ras", source="outer"
)
OUTER_FROM_INNER = Transform.from_rotation_vector(
    [0.0, 1.4, 0.4], [70.0, 8.0, 0.5], target="outer", source="inner"
)
RAS_FROM_NEEDLE = Transform.from_rotation_vector(
    [2.0, 0.4, 0.4], [1.0, 2.0, -50.0], target="ras", source="needle"
)


class Heard:
    def __init__(self) -> None:
        self.edits: list[Transform] = []
        self.refused: list[MarginGuardError] = []


@pytest.fixture
def heard() -> Heard:
    return Heard()


@pytest.fixture
def scene(heard: Heard) -> MarginGuardScene:
    scene = MarginGuardScene(vtkMRMLScene())
    scene.set_poses([NEEDLE], [Transform.identity("needle", "tumor")])
    scene.tree.on_edit("needle", heard.edits.append, heard.refused.append)
    return scene


def put(scene: MarginGuardScene, frame: str, pose: Transform) -> None:
    """As a user does, through the node."""
    scene.tree.node(frame).SetMatrixTransformToParent(vtk_matrix(pose))


def test_what_the_user_moves_is_reported_once_with_its_frames(
    scene: MarginGuardScene, heard: Heard
) -> None:
    put(scene, "needle", BY_HAND)
    put(scene, "needle", BY_HAND)
    (edit,) = heard.edits
    assert (edit.target, edit.source) == ("reference", "needle")
    assert np.allclose(edit.matrix, BY_HAND.matrix, rtol=0, atol=1e-12)


def test_our_own_moves_and_those_of_a_parent_are_no_edits(
    scene: MarginGuardScene, heard: Heard
) -> None:
    put(scene, "reference", BY_HAND.renamed(target="ras", source="reference"))
    scene.set_poses([BY_HAND])
    with scene.update():
        scene.set_poses([NEEDLE])
        scene.set_poses([BY_HAND])
    assert heard.edits == []
    put(scene, "needle", NEEDLE)
    assert len(heard.edits) == 1
    scene.set_poses([NEEDLE])  # what comes back from ROS is where the node is already
    assert len(heard.edits) == 1


def test_a_user_who_moves_it_back_to_where_we_had_it_is_heard(
    scene: MarginGuardScene, heard: Heard
) -> None:
    put(scene, "needle", BY_HAND)
    put(scene, "needle", NEEDLE)
    assert [np.allclose(edit.matrix, NEEDLE.matrix) for edit in heard.edits] == [False, True]


def test_a_frame_that_hangs_elsewhere_now_is_reported_there(
    scene: MarginGuardScene, heard: Heard
) -> None:
    scene.tree.set(Transform.identity("reference", "tracker"))
    scene.tree.set(NEEDLE.renamed(target="tracker"))
    put(scene, "needle", BY_HAND)
    assert [(edit.target, edit.source) for edit in heard.edits] == [("tracker", "needle")]


def test_what_is_not_rigid_is_told_and_not_reported(scene: MarginGuardScene, heard: Heard) -> None:
    stretched = vtkMatrix4x4()
    stretched.SetElement(0, 0, 1.5)
    scene.tree.node("needle").SetMatrixTransformToParent(stretched)
    assert heard.edits == []
    (error,) = heard.refused
    assert isinstance(error, TransformError)
    assert "reference_from_needle" in str(error)


def test_what_was_hung_elsewhere_by_the_user_is_told_and_not_reported(
    scene: MarginGuardScene, heard: Heard
) -> None:
    scene.tree.node("needle").SetAndObserveTransformNodeID(None)
    assert heard.edits == heard.refused == []
    put(scene, "needle", BY_HAND)
    assert heard.edits == []
    (error,) = heard.refused
    assert str(error) == (
        "NeedleToReference was moved under the world: its pose in 'reference' wanted"
    )


def test_an_error_of_the_listener_is_told(scene: MarginGuardScene, heard: Heard) -> None:
    """VTK would print it, and nobody would know."""

    def broadcast(edit: Transform) -> None:
        raise SceneError(f"{edit.source} cannot be sent")

    scene.tree.on_edit("needle", broadcast, heard.refused.append)
    put(scene, "needle", BY_HAND)
    assert [str(error) for error in heard.refused] == ["needle cannot be sent"]


def test_a_closed_watch_hears_nothing(heard: Heard) -> None:
    scene = vtkMRMLScene()
    node = scene.AddNewNodeByClass("vtkMRMLLinearTransformNode", "NeedleToReference")
    edited = EditedTransform(node, "reference", "needle", heard.edits.append, heard.refused.append)
    node.SetMatrixTransformToParent(vtk_matrix(NEEDLE))
    edited.close()
    edited.close()
    node.SetMatrixTransformToParent(vtk_matrix(BY_HAND))
    assert len(heard.edits) == 1


def test_only_what_is_in_the_scene_can_be_watched(scene: MarginGuardScene, heard: Heard) -> None:
    with pytest.raises(SceneError, match="frame 'probe' cannot be watched: it is not in the scene"):
        scene.tree.on_edit("probe", heard.edits.append, heard.refused.append)


# From here on: what a user made in the scene, in one of our frames.


@pytest.fixture
def application() -> SceneApplication:
    return SceneApplication(vtkMRMLScene())


def hang(application: SceneApplication, *poses: Transform | vtkMatrix4x4) -> vtkMRMLTransformNode:
    """A chain of transform nodes, the outermost first; the innermost."""
    parent = None
    for pose in poses:
        node = application.scene.AddNewNodeByClass("vtkMRMLLinearTransformNode")
        matrix = pose if isinstance(pose, vtkMatrix4x4) else vtk_matrix(pose)
        node.SetMatrixTransformToParent(matrix)
        node.SetAndObserveTransformNodeID(parent.GetID() if parent else None)
        parent = node
    return parent


def model_of(application: SceneApplication, surface: vtkPolyData) -> vtkMRMLModelNode:
    model = application.scene.AddNewNodeByClass("vtkMRMLModelNode", "Lesion")
    model.SetAndObservePolyData(surface)
    return model


def as_set(points: np.ndarray) -> np.ndarray:
    """Rows in an order of their own, so that two clouds can be compared."""
    rounded = np.round(points, 4)
    return points[np.lexsort(rounded.T)]


def test_model_through_its_parents_into_a_frame(
    application: SceneApplication, tumor: SurfaceMesh
) -> None:
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
    wanted = (RAS_FROM_OUTER @ OUTER_FROM_INNER).apply(tumor.vertices_mm)
    assert np.allclose(as_set(world.vertices_mm), as_set(wanted), atol=1e-9)


def test_reflected_model_keeps_its_normals_outward(
    application: SceneApplication, tumor: SurfaceMesh
) -> None:
    mirror = vtkMatrix4x4()
    mirror.SetElement(0, 0, -1.0)
    model = model_of(application, poly_data(tumor))
    model.SetAndObserveTransformNodeID(hang(application, mirror).GetID())
    mesh = mesh_of_model(model, "ras", None).require_closed("the lesion")
    assert np.allclose(
        as_set(mesh.vertices_mm), as_set(tumor.vertices_mm * [-1.0, 1.0, 1.0]), atol=1e-9
    )


def test_corners_that_a_file_has_for_every_triangle_are_merged(
    application: SceneApplication, tumor: SurfaceMesh
) -> None:
    soup = SurfaceMesh(
        "tumor", tumor.triangles_mm.reshape(-1, 3), np.arange(3 * len(tumor.faces)).reshape(-1, 3)
    )
    assert soup.open_edges() > 0
    mesh = mesh_of_model(model_of(application, poly_data(soup)), "tumor", None)
    assert mesh.require_closed("the lesion").vertices_mm.shape == tumor.vertices_mm.shape


def test_model_that_3d_slicer_saved_in_lps_is_where_it_was(
    application: SceneApplication, tumor: SurfaceMesh, tmp_path: Path
) -> None:
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
        as_set(mesh.vertices_mm),
        as_set(OUTER_FROM_INNER.apply(tumor.vertices_mm)),
        atol=1e-3,
    )


def test_model_without_a_triangle_is_refused(application: SceneApplication) -> None:
    with pytest.raises(SceneError, match="model 'Lesion' has no triangle"):
        mesh_of_model(model_of(application, vtkPolyData()), "ras", None)


VOXEL_MM, RADIUS_MM = 0.5, 6.0
CENTRE_MM = np.array([16.0, 27.5, 39.0])


@pytest.fixture
def segmentation(application: SceneApplication):
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


def test_segment_becomes_a_closed_surface_in_a_frame(
    application: SceneApplication, segmentation
) -> None:
    segmentation.SetAndObserveTransformNodeID(hang(application, RAS_FROM_OUTER).GetID())
    needle = hang(application, RAS_FROM_NEEDLE)
    mesh = mesh_of_segment(segmentation, "lesion", "needle", needle).require_closed("the lesion")
    centre = (RAS_FROM_NEEDLE.inverse() @ RAS_FROM_OUTER).apply(CENTRE_MM)
    from_centre = np.linalg.norm(mesh.vertices_mm - centre, axis=1)
    assert np.abs(from_centre - RADIUS_MM).max() < VOXEL_MM
    assert from_centre.mean() == pytest.approx(RADIUS_MM, abs=0.2 * VOXEL_MM)


@pytest.mark.parametrize(
    ("name", "words"),
    [("tumour", "0 segments of 'Seg' are called 'tumour': 1 wanted among lesion, nothing"),
     ("nothing", "segment 'nothing' of 'Seg' has no surface")],
)  # fmt: skip
def test_segment_that_is_not_there_is_refused(segmentation, name: str, words: str) -> None:
    with pytest.raises(SceneError, match=words):
        mesh_of_segment(segmentation, name, "ras", None)


def test_placed_points_through_their_parents_into_a_frame(application: SceneApplication) -> None:
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
    wanted = (RAS_FROM_NEEDLE.inverse() @ RAS_FROM_OUTER).apply(points)
    assert np.allclose(found, wanted, atol=1e-9)
