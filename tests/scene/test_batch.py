"""Events per update: one for each changed node, and one rendering."""

from collections import Counter

import numpy as np
import pytest
from slicer import vtkMRMLMarkupsNode, vtkMRMLTransformableNode
from vtkmodules.vtkCommonCore import vtkCommand

from app.fixture import MarginState, constrain
from app.geometry import Transform
from app.scene import MarginGuardScene
from tests.scene.scene_content import set_poses

pytestmark = pytest.mark.slow

TRANSFORM_MODIFIED = vtkMRMLTransformableNode.TransformModifiedEvent


def moved(edge, millimetres):
    shift = np.array([millimetres, 0.0, 0.0])
    return Transform(edge.target, edge.source, edge.rotation, edge.translation_mm + shift)


class Counts:
    """The events of every node of a scene, by its name."""

    def __init__(self, scene):
        self.transform: Counter[str] = Counter()
        self.modified: Counter[str] = Counter()
        for place in range(scene.GetNumberOfNodes()):
            node = scene.GetNthNode(place)
            self._count(node, TRANSFORM_MODIFIED, self.transform)
            self._count(node, vtkCommand.ModifiedEvent, self.modified)

    def clear(self):
        self.transform.clear()
        self.modified.clear()

    @staticmethod
    def _count(node, event, counter):
        name = node.GetName() or node.GetID()
        node.AddObserver(event, lambda *_: counter.update([name]))


@pytest.fixture
def scene(application, fill):
    return fill(MarginGuardScene(application.scene, logic=application.logic))


def test_each_moved_transform_notifies_once(scene, edges, fixed, decision, arm):
    links = arm.forward_kinematics({"shoulder": 0.3, "elbow": 0.2})
    scene.show(decision(MarginState.NEGATIVE, 9.0), {"arm": links})
    counts = Counts(scene.scene)
    links = arm.forward_kinematics({"shoulder": 0.4, "elbow": 0.1})
    with scene.update():
        # Moved twice, with its parents' and children's moves between: still once each.
        for step in (1.0, 2.0):
            needle, cautery = moved(edges[1], step), moved(edges[2], step)
            base = moved(fixed[2], step)
            set_poses(scene, (edges[0], needle, cautery), (fixed[0], moved(fixed[1], step), base))
            scene.show(decision(MarginState.WARNING, step), {"arm": links})
        assert not counts.transform and not counts.modified
    transforms = {"NeedleToReference", "TumorToNeedle", "CauteryToReference"}
    transforms |= {"CauteryTipToCautery", "RobotBaseToReference", "BaseToRobotBase"}
    transforms |= {"UpperToBase", "ForeArmToBase"}
    models = {"Tumor", "Tool", "base_model", "upper_model", "fore_arm_model"}
    markups = {"ClosestPoints", "FixturePlane", "BreachMarkers"}
    assert dict(counts.transform) == dict.fromkeys(transforms | models | markups, 1)
    assert max(counts.modified.values()) == 1


def test_plane_and_marks_notify_at_the_end_of_the_update(scene, decision):
    counts = Counts(scene.scene)
    inside = decision(MarginState.POSITIVE, -2.0)
    constraint = constrain(inside.proximity, 1.0, frame="tumor")
    with scene.update():
        scene.show(inside._replace(constraint=constraint, constraint_is_current=True), {})
        assert not counts.modified
    assert counts.modified["FixturePlane"] == 1


def test_unchanged_nodes_do_not_notify(scene, edges, fixed, decision, arm):
    links = arm.forward_kinematics({"shoulder": 0.3, "elbow": 0.2})
    shown = decision(MarginState.NEGATIVE, 9.0)
    scene.show(shown, {"arm": links})
    counts = Counts(scene.scene)
    points: list[int] = []
    scene.margin.line.AddObserver(
        vtkMRMLMarkupsNode.PointModifiedEvent, lambda *_: points.append(1)
    )
    with scene.update():
        set_poses(scene, edges, fixed)
        scene.show(shown, {"arm": links})
    assert not counts.transform and not counts.modified and not points


def test_events_are_sent_after_an_error(scene, edges):
    counts = Counts(scene.scene)
    with pytest.raises(ZeroDivisionError), scene.update():
        set_poses(scene, (edges[0], moved(edges[1], 4.0)))
        raise ZeroDivisionError
    assert counts.transform["NeedleToReference"] == 1
    counts.clear()
    set_poses(scene, (edges[0], moved(edges[1], 5.0)))
    assert counts.transform["NeedleToReference"] == 1


def test_rendering_is_paused_once_per_update(application, scene, edges, fixed):
    logic, events = application.logic, []
    observers = [
        logic.AddObserver(logic.PauseRenderEvent, lambda *_: events.append("pause")),
        logic.AddObserver(logic.ResumeRenderEvent, lambda *_: events.append("resume")),
    ]
    with scene.update():
        set_poses(scene, (edges[0], moved(edges[1], 1.0), moved(edges[2], 1.0)), fixed)
        assert events == ["pause"]
    assert events == ["pause", "resume"]
    for observer in observers:
        logic.RemoveObserver(observer)
