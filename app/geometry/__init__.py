"""Values that all packages share: frames, stamps, transforms, meshes, errors.

Units are mm, rad and integer ns. Imports numpy and scipy only.
"""

from app.geometry.anatomy import (
    ANATOMICAL_AXES,
    ANATOMICAL_WORDS,
    anatomical_direction,
    anatomical_words,
)
from app.geometry.errors import (
    FrameError,
    InputError,
    MarginGuardError,
    MeshError,
    StampError,
    TransformError,
)
from app.geometry.frame_graph import Edge, chain_to_root, poses_in, product_along, shortest_path
from app.geometry.frames import (
    camel_case,
    check_frame,
    join_transform_name,
    snake_case,
    split_transform_name,
)
from app.geometry.freshness import (
    Freshness,
    FreshnessLimits,
    freshness_of,
    freshness_of_stamp,
    stale_in_ns,
)
from app.geometry.image import MAX_IMAGE_SIDE, PIXEL_TYPES, ImageSample, ImageStatus, Pixels
from app.geometry.image_calibration import ImageCalibration, image_corners
from app.geometry.mesh import SurfaceMesh
from app.geometry.plain_number import is_plain_number
from app.geometry.quaternion_arrays import quaternions_of_rotations, rotations_of_quaternions
from app.geometry.slots import slot_setters
from app.geometry.stamp import NS_PER_MS, NS_PER_S, Stamp
from app.geometry.stamp_history import StampHistory
from app.geometry.tracked import TrackedTransform, TrackingStatus
from app.geometry.transform import (
    ROTATION_TOLERANCE,
    FloatArray,
    Transform,
    closest_rotation,
    mean_transform,
    mismatched_frames,
    quaternion_of_rotation,
    rotation_angle,
    rotation_of_quaternion,
)
from app.geometry.welding import weld_vertices

__all__ = [
    "ANATOMICAL_AXES",
    "ANATOMICAL_WORDS",
    "MAX_IMAGE_SIDE",
    "NS_PER_MS",
    "NS_PER_S",
    "PIXEL_TYPES",
    "ROTATION_TOLERANCE",
    "Edge",
    "FloatArray",
    "FrameError",
    "Freshness",
    "FreshnessLimits",
    "ImageCalibration",
    "ImageSample",
    "ImageStatus",
    "InputError",
    "MarginGuardError",
    "MeshError",
    "Pixels",
    "Stamp",
    "StampError",
    "StampHistory",
    "SurfaceMesh",
    "TrackedTransform",
    "TrackingStatus",
    "Transform",
    "TransformError",
    "anatomical_direction",
    "anatomical_words",
    "camel_case",
    "chain_to_root",
    "check_frame",
    "closest_rotation",
    "freshness_of",
    "freshness_of_stamp",
    "image_corners",
    "is_plain_number",
    "join_transform_name",
    "mean_transform",
    "mismatched_frames",
    "poses_in",
    "product_along",
    "quaternion_of_rotation",
    "quaternions_of_rotations",
    "rotation_angle",
    "rotation_of_quaternion",
    "rotations_of_quaternions",
    "shortest_path",
    "slot_setters",
    "snake_case",
    "split_transform_name",
    "stale_in_ns",
    "weld_vertices",
]
