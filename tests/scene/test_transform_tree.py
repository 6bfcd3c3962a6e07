import numpy as np
import pytest
from slicer import vtkMRMLScene

from app.geometry import Transform, split_transform_name
from app.scene import SceneError, TransformTree
from app.scene.convert import world_matrix
from tests.scene.conftest import posed

pytestmark = pytest.mark.slow


def pose(target, source, seed):
    rng = np.random.default_rng(seed)
    return posed(target, source, rng.normal(size=3), rng.normal(size=3))


def test_nodes_have_slicer_igt_names_and_world_poses():
    scene = vtkMRMLScene()
    tree = TransformTree(scene)
    ras, cautery, tip = (
        pose("ras", "reference", 1),
        pose("reference", "cautery", 2),
        pose("cautery", "cautery_tip", 3),
    )
    for edge in (ras, cautery, tip):
        tree.set(edge)
    for name in ("ReferenceToRas", "CauteryToReference", "CauteryTipToCautery"):
        assert scene.GetFirstNodeByName(name) is not None
    assert np.allclose(world_matrix(tree.node("cautery_tip")), (ras @ cautery @ tip).matrix)
    moved = pose("reference", "cautery", 4)
    tree.set(moved)
    assert np.allclose(world_matrix(tree.node("cautery_tip")), (ras @ moved @ tip).matrix)
    assert scene.GetNumberOfNodesByClass("vtkMRMLLinearTransformNode") == 3


def test_lumpnav_tree_has_its_names_and_parents():
    scene = vtkMRMLScene()
    tree = TransformTree(scene)
    expected = {
        "ReferenceToRas": None,
        "NeedleToReference": "ReferenceToRas",
        "NeedleTipToNeedle": "NeedleToReference",
        "CauteryToReference": "ReferenceToRas",
        "CauteryTipToCautery": "CauteryToReference",
        "ProbeToReference": "ReferenceToRas",
        "ImageToProbe": "ProbeToReference",
    }
    for name in expected:
        source, target = split_transform_name(name)
        tree.set(pose(target, source, len(name)))
    found = {}
    for node in tree.nodes():
        parent = node.GetParentTransformNode()
        found[node.GetName()] = None if parent is None else parent.GetName()
    assert found == expected


def test_frame_with_another_parent_is_renamed():
    scene = vtkMRMLScene()
    tree = TransformTree(scene)
    tree.set(pose("ras", "reference", 1))
    tree.set(pose("ras", "tracker", 2))
    tree.set(pose("reference", "cautery", 3))
    tree.set(pose("tracker", "cautery", 4))
    assert scene.GetFirstNodeByName("CauteryToReference") is None
    expected = pose("ras", "tracker", 2) @ pose("tracker", "cautery", 4)
    assert np.allclose(world_matrix(tree.node("cautery")), expected.matrix)


def test_unknown_target_is_refused():
    scene = vtkMRMLScene()
    tree = TransformTree(scene)
    tree.set(pose("ras", "reference", 1))
    with pytest.raises(
        SceneError, match="CauteryToTracker: frame 'tracker' is not in the scene; expected"
    ):
        tree.set(pose("tracker", "cautery", 2))
    assert tree.node("cautery") is None
    assert scene.GetNumberOfNodesByClass("vtkMRMLLinearTransformNode") == 1


def test_frame_moved_under_another_parent_is_put_back_but_not_the_root():
    scene = vtkMRMLScene()
    theirs = scene.AddNewNodeByClass("vtkMRMLLinearTransformNode", "PatientToRas")
    tree = TransformTree(scene)
    root = tree.set(pose("ras", "reference", 1))
    cautery = tree.set(pose("reference", "cautery", 2))
    root.SetAndObserveTransformNodeID(theirs.GetID())
    cautery.SetAndObserveTransformNodeID(theirs.GetID())
    tree.set(pose("ras", "reference", 1))
    tree.set(pose("reference", "cautery", 2))
    assert root.GetParentTransformNode() is theirs
    assert cautery.GetParentTransformNode() is root


@pytest.mark.parametrize("target", ["cautery", "cautery_tip"])
def test_frame_below_itself_is_refused(target):
    tree = TransformTree(vtkMRMLScene())
    tree.set(pose("ras", "reference", 1))
    cautery = tree.set(pose("reference", "cautery", 2))
    tree.set(pose("cautery", "cautery_tip", 3))
    with pytest.raises(SceneError, match=f"frame '{target}' is below 'cautery'; expected a tree"):
        tree.set(Transform.identity(target, "cautery"))
    assert cautery.GetName() == "CauteryToReference"
    assert cautery.GetParentTransformNode() is tree.node("reference")


def test_clear_leaves_other_nodes():
    scene = vtkMRMLScene()
    scene.AddNewNodeByClass("vtkMRMLLinearTransformNode", "Theirs")
    tree = TransformTree(scene)
    tree.set(pose("ras", "reference", 1))
    tree.clear()
    assert scene.GetNumberOfNodesByClass("vtkMRMLLinearTransformNode") == 1
    assert scene.GetFirstNodeByName("Theirs") is not None
