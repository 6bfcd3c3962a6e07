import numpy as np
import pytest
from slicer import vtkMRMLScene
from vtkmodules.vtkCommonMath import vtkMatrix4x4

from app.geometry import MarginGuardError, Transform, TransformError
from app.scene import EditedTransform, MarginGuardScene, SceneError
from app.scene.nodes.convert import vtk_matrix

NEEDLE = Transform.from_rotation_vector(
    [0.1, 0.2, 0.3], [10.0, 20.0, 30.0], target="reference", source="needle"
)
BY_HAND = Transform.from_rotation_vector(
    [0.5, -0.2, 0.1], [-4.0, 5.0, 6.0], target="reference", source="needle"
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
