"""Translucent copy of a robot at a goal pose, by SlicerROS2's names."""

import logging
from typing import Any

from slicer import vtkMRMLLinearTransformNode, vtkMRMLModelDisplayNode, vtkMRMLModelNode
from vtkmodules.vtkCommonMath import vtkMatrix4x4

COLOUR = (0.0, 1.0, 1.0)
OPACITY = 0.3
MODEL_ROLE, TRANSFORM_ROLE = "goal_model", "goal_transform"


def create_goal(robot: Any, source: Any) -> bool:
    """Copy the links of ``source`` at their present poses; False, with a log line, without links.

    The copies are references of ``robot``, of roles ``goal_model`` and ``goal_transform``. They
    stay where they are until a script moves the transforms. If there are some, nothing is done.
    """
    scene = robot.GetScene()
    if scene is None or source is None or source.GetScene() is None:
        logging.error("CreateGoalStateRobot: both robots must be in a scene")
        return False
    if robot.GetNumberOfNodeReferences(MODEL_ROLE):
        return True
    nodes = source.link_nodes()
    if not nodes:
        logging.error(f"CreateGoalStateRobot: {source.GetName()} has no links yet")
        return False
    transforms = {}
    for link, node in nodes.items():
        made = vtkMRMLLinearTransformNode()
        made.SetName(f"{link}_goal_transform")
        scene.AddNode(made)
        matrix = vtkMatrix4x4()
        node.GetMatrixTransformToParent(matrix)
        made.SetMatrixTransformToParent(matrix)
        transforms[node.GetID()] = made
        robot.AddNodeReferenceID(TRANSFORM_ROLE, made.GetID())
    for node in nodes.values():
        parent = transforms.get(node.GetTransformNodeID() or "")
        if parent is not None:
            transforms[node.GetID()].SetAndObserveTransformNodeID(parent.GetID())
    for model in _references(source, "model"):
        _copy_model(robot, model, transforms[model.GetTransformNodeID()])
    return True


def remove_goal(robot: Any) -> bool:
    """Remove the copies that `create_goal` has made; False if the robot is in no scene."""
    scene = robot.GetScene()
    if scene is None:
        logging.error("RemoveGoalStateRobot: the robot must be in a scene")
        return False
    for model in _references(robot, MODEL_ROLE):
        scene.RemoveNode(model.GetDisplayNode())
        scene.RemoveNode(model)
    for transform in _references(robot, TRANSFORM_ROLE):
        scene.RemoveNode(transform)
    robot.RemoveNodeReferenceIDs(MODEL_ROLE)
    robot.RemoveNodeReferenceIDs(TRANSFORM_ROLE)
    return True


def _copy_model(robot: Any, model: Any, transform: Any) -> None:
    scene = robot.GetScene()
    display = vtkMRMLModelDisplayNode()
    display.SetColor(*COLOUR)
    display.SetOpacity(OPACITY)
    scene.AddNode(display)
    made = vtkMRMLModelNode()
    made.SetName(f"{model.GetName()}_goal")
    made.SetAndObservePolyData(model.GetPolyData())
    scene.AddNode(made)
    made.SetAndObserveDisplayNodeID(display.GetID())
    made.SetAndObserveTransformNodeID(transform.GetID())
    robot.AddNodeReferenceID(MODEL_ROLE, made.GetID())


def _references(node: Any, role: str) -> list[Any]:
    each = (node.GetNthNodeReference(role, n) for n in range(node.GetNumberOfNodeReferences(role)))
    return [found for found in each if found is not None]
