"""Collision objects of MoveIt from model nodes of the scene."""

from typing import Any

import numpy as np
from slicer import vtkMRMLModelNode

from app.bridge.convert import collision_object, removed_object
from app.geometry import Transform, TransformError
from app.scene.convert import triangles_of, world_matrix
from ROS2Lib.member import Ros2Error
from ROS2Lib.ros_message import message_of

_WORLD, _MODEL = "world", "model"


def message_of_model(kind: Any, value: Any) -> Any:
    """`CollisionObject` that adds a model, or the message of a filled-in blank message.

    The model's triangles are at its pose in the scene's world (RAS). Raises as `placed_surface`.
    """
    if not isinstance(value, vtkMRMLModelNode):
        return message_of(value, kind)
    return collision_object(_identifier(value), *placed_surface(value, _WORLD, _MODEL))


def removal_of_model(model: Any) -> Any:
    """`CollisionObject` that removes a model; raises `Ros2Error` for another value."""
    if not isinstance(model, vtkMRMLModelNode):
        raise Ros2Error(f"value is a {type(model).__name__}; expected a vtkMRMLModelNode")
    return removed_object(_identifier(model))


def placed_surface(model: vtkMRMLModelNode, world: str, frame: str) -> tuple[Any, Any, Transform]:
    """Vertices (n, 3) in mm in ``frame``, triangles (m, 3), and ``world_from_frame`` of a model.

    A transform that is not rigid is applied to the vertices. Raises `Ros2Error` for a model without
    a surface or below a transform that is not linear.
    """
    parent = model.GetParentTransformNode()
    if parent is not None and not parent.IsTransformToWorldLinear():
        raise Ros2Error(
            f"{model.GetName()} is below the non-linear transform {parent.GetName()}; "
            "expected linear ones (harden it)"
        )
    surface = model.GetPolyData()
    if surface is None or surface.GetNumberOfPolys() + surface.GetNumberOfStrips() == 0:
        raise Ros2Error(f"{model.GetName()} has no surface; expected a model with polygons")
    vertices, triangles = triangles_of(surface)
    matrix = world_matrix(parent)
    try:
        pose = Transform.from_matrix(matrix, target=world, source=frame)
    except TransformError:
        vertices = vertices @ matrix[:3, :3].T + matrix[:3, 3]
        if np.linalg.det(matrix[:3, :3]) < 0.0:  # a mirrored surface would be inside out
            triangles = triangles[:, ::-1]
        pose = Transform.identity(target=world, source=frame)
    return vertices, triangles, pose


def _identifier(model: vtkMRMLModelNode) -> str:
    """The name that MoveIt shows; the MRML ID for a model without one."""
    return model.GetName() or model.GetID() or ""
