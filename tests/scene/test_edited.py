import numpy as np
import pytest
from slicer import vtkMRMLScene
from vtkmodules.vtkCommonMath import vtkMatrix4x4

from app.geometry import MarginGuardError, Transform, TransformError
from app.scene import EditedTransform, MarginGuardScene, SceneError
from app.scene.convert import vtk_matrix
from tests.scene.conftest import posed
from tests.scene.scene_content import set_poses

pytestmark = pytest.mark.slow

NEEDLE = posed("reference", "needle", [0.1, 0.2, 0.3], [10.0, 20.0, 30.0])
BY_HAND = posed("reference", "needle", [0.5, -0.2, 0.1], [-4.0, 5.0, 6.0])


class Reported:
    def __init__(self):
        self.edits: list[Transform] = []
        self.refused: list[MarginGuardError] = []


@pytest.fixture
def reported():
    return Reported()


@pytest.fixture
def scene(reported):
    scene = MarginGuardScene(vtkMRMLScene())
    set_poses(scene, [NEEDLE], [Transform.identity("needle", "tumor")])
    scene.tree.on_edit("needle", reported.edits.append, reported.refused.append)
    return scene


def put(scene, frame, pose):
    """Move the node as a user does."""
    scene.tree.node(frame).SetMatrixTransformToParent(vtk_matrix(pose))


def test_edit_is_reported_once_with_its_frames(scene, reported):
    put(scene, "needle", BY_HAND)
    put(scene, "needle", BY_HAND)
    (edit,) = reported.edits
    assert (edit.target, edit.source) == ("reference", "needle")
    assert np.allclose(edit.matrix, BY_HAND.matrix, rtol=0, atol=1e-12)


def test_moves_by_set_and_of_a_parent_are_not_reported(scene, reported):
    put(scene, "reference", BY_HAND.renamed(target="ras", source="reference"))
    set_poses(scene, [BY_HAND])
    with scene.update():
        set_poses(scene, [NEEDLE])
        set_poses(scene, [BY_HAND])
    assert reported.edits == []
    put(scene, "needle", NEEDLE)
    assert len(reported.edits) == 1
    set_poses(scene, [NEEDLE])  # what comes back from ROS is where the node is already
    assert len(reported.edits) == 1


def test_edit_back_to_the_pose_set_before_is_reported(scene, reported):
    put(scene, "needle", BY_HAND)
    put(scene, "needle", NEEDLE)
    assert [np.allclose(edit.matrix, NEEDLE.matrix) for edit in reported.edits] == [False, True]


def test_edit_after_a_change_of_parent_has_the_new_parent_frame(scene, reported):
    scene.tree.set(Transform.identity("reference", "tracker"))
    scene.tree.set(NEEDLE.renamed(target="tracker"))
    put(scene, "needle", BY_HAND)
    assert [(edit.target, edit.source) for edit in reported.edits] == [("tracker", "needle")]


def test_edit_that_is_not_rigid_is_refused(scene, reported):
    stretched = vtkMatrix4x4()
    stretched.SetElement(0, 0, 1.5)
    scene.tree.node("needle").SetMatrixTransformToParent(stretched)
    assert reported.edits == []
    (error,) = reported.refused
    assert isinstance(error, TransformError)
    assert "reference_from_needle" in str(error)


def test_edit_under_an_unknown_parent_is_refused(scene, reported):
    scene.tree.node("needle").SetAndObserveTransformNodeID(None)
    assert reported.edits == reported.refused == []
    put(scene, "needle", BY_HAND)
    assert reported.edits == []
    (error,) = reported.refused
    assert str(error) == (
        "NeedleToReference: parent is the world; expected the node of 'reference'"
    )


def test_error_of_the_listener_goes_to_on_refused(scene, reported):
    """VTK would only print it."""

    def broadcast(edit):
        raise SceneError(f"{edit.source} cannot be sent")

    scene.tree.on_edit("needle", broadcast, reported.refused.append)
    put(scene, "needle", BY_HAND)
    assert [str(error) for error in reported.refused] == ["needle cannot be sent"]


def test_closed_watch_reports_nothing(reported):
    scene = vtkMRMLScene()
    node = scene.AddNewNodeByClass("vtkMRMLLinearTransformNode", "NeedleToReference")
    edited = EditedTransform(
        node, "reference", "needle", reported.edits.append, reported.refused.append
    )
    node.SetMatrixTransformToParent(vtk_matrix(NEEDLE))
    edited.close()
    edited.close()
    node.SetMatrixTransformToParent(vtk_matrix(BY_HAND))
    assert len(reported.edits) == 1


def test_frame_that_is_not_in_the_scene_cannot_be_watched(scene, reported):
    with pytest.raises(SceneError, match="frame 'probe' is not in the scene; expected one of"):
        scene.tree.on_edit("probe", reported.edits.append, reported.refused.append)
