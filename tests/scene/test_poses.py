"""Frames moved together: their poses and their events."""

from collections import Counter

import numpy as np
import pytest
from slicer import vtkMRMLScene, vtkMRMLTransformableNode
from vtkmodules.vtkCommonMath import vtkMatrix4x4

from app.scene import PoseNodes, SceneError, TransformTree
from app.scene.convert import poly_data, world_matrix
from app.scene.models import add_model
from app.scene.scene_nodes import Batch
from tests.scene.conftest import posed

pytestmark = pytest.mark.slow

FRAMES = tuple(f"body_{number}" for number in range(26))
TRANSFORM_MODIFIED = vtkMRMLTransformableNode.TransformModifiedEvent


def poses(seed):
    rng = np.random.default_rng(seed)
    return np.array(
        [
            posed("world", frame, rng.normal(size=3), rng.normal(scale=100.0, size=3)).matrix
            for frame in FRAMES
        ]
    )


def count_events(node):
    events: Counter[str] = Counter()
    node.AddObserver(TRANSFORM_MODIFIED, lambda *_: events.update(["transform"]))
    node.AddObserver("ModifiedEvent", lambda *_: events.update(["modified"]))
    return events


def test_each_frame_has_its_pose_below_the_root():
    scene = vtkMRMLScene()
    ras_from_world = posed("ras", "world", [0.3, 0.2, 0.1], [7.0, 8.0, 9.0])
    nodes = PoseNodes(scene, "world", FRAMES, TransformTree(scene).set(ras_from_world))
    assert scene.GetFirstNodeByName("Body7ToWorld") is nodes.nodes["body_7"]
    for seed in (1, 2):
        expected = poses(seed)
        assert nodes.move(expected) == len(FRAMES)
        for frame, world_from_body in zip(FRAMES, expected, strict=True):
            found = world_matrix(nodes.nodes[frame])
            assert np.allclose(found, ras_from_world.matrix @ world_from_body, rtol=0, atol=1e-9)


def test_root_is_the_world_without_a_parent():
    nodes = PoseNodes(vtkMRMLScene(), "world", FRAMES)
    nodes.move(poses(3))
    assert np.array_equal(world_matrix(nodes.nodes["body_25"]), poses(3)[25])


def test_moved_nodes_notify_once_and_others_not_at_all(tumor):
    scene = vtkMRMLScene()
    nodes = PoseNodes(scene, "world", FRAMES)
    surface = poly_data(tumor)
    models = [
        add_model(scene, frame, surface, (1.0, 1.0, 1.0), parent=nodes.nodes[frame])
        for frame in FRAMES
    ]
    first = poses(4)
    nodes.move(first)
    of_nodes = [count_events(node) for node in nodes.nodes.values()]
    of_models = [count_events(model) for model in models]
    assert nodes.move(first.copy()) == 0
    assert not any(of_nodes) and not any(of_models)
    second = first.copy()
    second[[3, 20], 0, 3] += 1.0
    assert nodes.move(second) == 2
    for place, (of_node, of_model) in enumerate(zip(of_nodes, of_models, strict=True)):
        moved = int(place in (3, 20))
        assert of_node["transform"] == of_model["transform"] == moved
        assert of_node["modified"] <= 1 and of_model["modified"] <= 1


def test_node_moved_by_a_user_is_put_back():
    nodes = PoseNodes(vtkMRMLScene(), "world", FRAMES)
    nodes.move(poses(7))
    nodes.nodes["body_3"].SetMatrixTransformToParent(vtkMatrix4x4())
    assert nodes.move(poses(7)) == 1
    assert np.array_equal(world_matrix(nodes.nodes["body_3"]), poses(7)[3])


def test_observers_are_notified_once_at_the_end_of_an_open_batch():
    scene = vtkMRMLScene()
    batch = Batch(scene)
    nodes = PoseNodes(scene, "world", FRAMES, batch=batch)
    events = count_events(nodes.nodes["body_3"])
    with batch.changes():
        nodes.move(poses(8))
        nodes.move(poses(9))
        assert not events
    assert events["transform"] == 1
    assert np.array_equal(world_matrix(nodes.nodes["body_3"]), poses(9)[3])


@pytest.mark.parametrize(
    ("broken", "words"),
    [
        (poses(5)[:-1], r"shape is \(25, 4, 4\); expected \(26, 4, 4\)"),
        (np.where(np.arange(26)[:, None, None] == 7, np.nan, poses(5)), "'body_7': not finite"),
    ],
)
def test_refused_poses_move_nothing(broken, words):
    nodes = PoseNodes(vtkMRMLScene(), "world", FRAMES)
    nodes.move(poses(6))
    with pytest.raises(SceneError, match=words):
        nodes.move(broken)
    assert np.array_equal(world_matrix(nodes.nodes["body_0"]), poses(6)[0])


def test_frame_given_twice_is_refused():
    scene = vtkMRMLScene()
    with pytest.raises(SceneError, match="left, left; expected each frame once"):
        PoseNodes(scene, "world", ("left", "left"))
    assert scene.GetNumberOfNodesByClass("vtkMRMLLinearTransformNode") == 0


def test_remove_leaves_other_nodes():
    scene = vtkMRMLScene()
    scene.AddNewNodeByClass("vtkMRMLLinearTransformNode", "Theirs")
    PoseNodes(scene, "world", FRAMES).remove()
    assert scene.GetNumberOfNodesByClass("vtkMRMLLinearTransformNode") == 1
