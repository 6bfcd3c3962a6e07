"""A scene that was saved and loaded again: its nodes are reused, not added a second time."""

from dataclasses import replace

import numpy as np
import pytest
from slicer import vtkMRMLScene

from app.fixture import MarginState
from app.geometry import Stamp, TrackedTransform, TrackingStatus, Transform
from app.scene import MarginGuardScene, SceneApplication, add_sequences, save_scene
from app.scene.convert import world_matrix
from app.scene.sequences import BROWSER_NAME
from tests.scene.conftest import loaded
from tests.scene.scene_content import content, set_poses

pytestmark = pytest.mark.slow

STALE_NS = 200_000_000


@pytest.fixture
def opened(fill, arm, decision, tmp_path):
    """A whole scene in a breach, loaded from a file, with a user's model below the tool's tip."""
    first = SceneApplication(vtkMRMLScene())
    scene = fill(MarginGuardScene(first.scene))
    links = {"arm": arm.forward_kinematics({"shoulder": 0.7})}
    scene.show(decision(MarginState.POSITIVE, -3.25), links)
    users = first.scene.AddNewNodeByClass("vtkMRMLMarkupsFiducialNode", "UsersPoints")
    users.SetAndObserveTransformNodeID(scene.tree.node("cautery_tip").GetID())
    save_scene(first.scene, tmp_path / "scene.mrb")
    return loaded(tmp_path / "scene.mrb")


def named(scene, name):
    nodes = (scene.GetNthNode(place) for place in range(scene.GetNumberOfNodes()))
    return [node.GetID() for node in nodes if node.GetName() == name]


def test_adopted_scene_reuses_the_nodes(opened, fill):
    scene = opened.scene
    before = content(scene)
    ids = {name: named(scene, name) for name in ("Tumor", "Tool", "ReferenceToRas")}
    nodes = scene.GetNumberOfNodes()
    fill(MarginGuardScene(scene, stale_after_ns=STALE_NS, adopt_nodes=True))
    assert content(scene).keys() == before.keys()  # fails on a name that is there twice, too
    assert scene.GetNumberOfNodes() == nodes
    assert {name: named(scene, name) for name in ids} == ids


def test_nodes_are_not_adopted_by_default(opened, fill):
    fill(MarginGuardScene(opened.scene))
    assert len(named(opened.scene, "Tumor")) == len(named(opened.scene, "CauteryToReference")) == 2


def test_node_of_the_user_below_an_adopted_frame_moves_with_it(opened, fill, edges):
    (users_id,) = named(opened.scene, "UsersPoints")
    scene = fill(MarginGuardScene(opened.scene, adopt_nodes=True))
    tip = scene.tree.node("cautery_tip")
    assert opened.scene.GetNodeByID(users_id).GetParentTransformNode() is tip
    at = world_matrix(tip)
    moved = Transform("reference", "cautery", np.eye(3), [1.0, 2.0, 3.0])
    set_poses(scene, [moved])
    assert not np.allclose(world_matrix(tip), at)


def test_saved_state_is_not_shown_as_the_present(opened, edges, tumor):
    scene = MarginGuardScene(opened.scene, stale_after_ns=STALE_NS, adopt_nodes=True)
    node = opened.scene.GetFirstNodeByName("Tumor")
    tool = opened.scene.GetFirstNodeByName("Tool")
    assert not node.GetDisplayVisibility()
    assert not tool.GetDisplayVisibility()
    for name in ("ClosestPoints", "MarginStatus", "BreachMarkers", "upper_model"):
        assert named(opened.scene, name) == []
    needle = Transform("needle", "tumor", np.eye(3), [0.0, 0.0, 0.0])
    set_poses(scene, edges, [needle])
    assert scene.add_tumor(tumor) is node
    assert node.GetDisplayVisibility()
    assert node.GetDisplayNode().GetColor() == MarginState.UNKNOWN.color
    assert len(scene.margin.breaches) == 0
    assert not tool.GetDisplayVisibility()


def test_node_of_another_module_is_not_adopted(fill):
    application = SceneApplication(vtkMRMLScene())
    add = application.scene.AddNewNodeByClass
    theirs = add("vtkMRMLLinearTransformNode", "CauteryToReference")
    tumor = add("vtkMRMLModelNode", "Tumor")
    scene = fill(MarginGuardScene(application.scene, adopt_nodes=True))
    assert scene.tree.node("cautery") is not theirs
    assert scene.tumor is not tumor
    scene.clear()
    assert application.scene.IsNodePresent(theirs)
    assert application.scene.IsNodePresent(tumor)


def test_clear_removes_the_adopted_nodes(opened, fill):
    fill(MarginGuardScene(opened.scene, adopt_nodes=True)).clear()
    assert content(opened.scene).keys() == {"UsersPoints"}


def test_saved_recording_does_not_change_adopted_nodes(fill, edges, decision, tmp_path):
    first = SceneApplication(vtkMRMLScene())
    saved = fill(MarginGuardScene(first.scene))
    good = [TrackedTransform(edge, Stamp(0), TrackingStatus.OK) for edge in edges]
    frames = [
        [replace(each, stamp=Stamp(index * 20_000_000)) for each in good] for index in (0, 1, 2)
    ]
    states = [(index * 20_000_000, MarginState.NEGATIVE, ()) for index in (0, 1, 2)]
    saved.show(decision(MarginState.NEGATIVE, 7.0), {})
    add_sequences(saved, frames, states, 20_000_000)
    save_scene(first.scene, tmp_path / "scene.mrb")
    second = loaded(tmp_path / "scene.mrb")
    browser = second.scene.GetFirstNodeByName(BROWSER_NAME)
    users = second.scene.AddNewNodeByClass("vtkMRMLSequenceBrowserNode", "Users")
    scene = fill(MarginGuardScene(second.scene, stale_after_ns=STALE_NS, adopt_nodes=True))
    moved = Transform("reference", "cautery", np.eye(3), [1.0, 2.0, 3.0])
    set_poses(scene, [moved])
    at = world_matrix(scene.tree.node("cautery_tip"))
    for item in (0, 2, 1):
        browser.SetSelectedItemNumber(item)
        assert scene.tumor.GetDisplayNode().GetColor() == MarginState.UNKNOWN.color
        assert scene.tool.GetDisplayNode().GetColor() == MarginState.UNKNOWN.color
        assert scene.margin.status.GetText() == ""
        assert np.array_equal(world_matrix(scene.tree.node("cautery_tip")), at)
    assert named(second.scene, "MarginGuard-NeedleToReference-Seq")
    assert second.scene.IsNodePresent(users)
