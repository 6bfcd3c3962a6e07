"""Values that flow through every room: frames, stamps, transforms, meshes, errors.

Millimetres, radians and integer nanoseconds. Imports numpy and scipy only.
"""

from app.geometry.errors import (
    FrameError,
    InputError,
    MarginGuardError,
    MeshError,
    StampError,
    TransformError,
)
from app.geometry.frames import (
    camel_case,
    check_frame,
    join_transform_name,
    snake_case,
    split_transform_name,
)
from app.geometry.mesh import SurfaceMesh
from app.geometry.plain_text import is_plain
from app.geometry.slots import setters
from app.geometry.stamp import NS_PER_MS, NS_PER_S, Stamp
from app.geometry.tracked import TrackedTransform, TrackingStatus
from app.geometry.transform import (
    FloatArray,
    Transform,
    mean_transform,
    rotation_angle,
    rotation_of_quaternion,
)
from app.geometry.welding import welded

__all__ = [
    "NS_PER_MS",
    "NS_PER_S",
    "FloatArray",
    "FrameError",
    "InputError",
    "MarginGuardError",
    "MeshError",
    "Stamp",
    "StampError",
    "SurfaceMesh",
    "TrackedTransform",
    "TrackingStatus",
    "Transform",
    "TransformError",
    "camel_case",
    "check_frame",
    "is_plain",
    "join_transform_name",
    "mean_transform",
    "rotation_angle",
    "rotation_of_quaternion",
    "setters",
    "snake_case",
    "split_transform_name",
    "welded",
]
