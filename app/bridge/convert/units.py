"""Table of the unit scales, per field, between messages (m) and plain values (mm).

A type is scaled wherever it occurs, also nested: `Point` in `Pose`, `Pose` in `PoseArray`, and so
on. `Vector3` has no unit of its own; the message that contains it defines it. An entry for a field
applies to everything in that field and overrides the entry of the field's type (an `ImageMarker`
has points in pixels).

Radians, seconds, newtons, newton metres, colours and plain numbers are not scaled. `JointState` and
`JointTrajectory` are not scaled either: their numbers are rad or m depending on the joint. The
bytes of `Image` and `PointCloud2` are unchanged; `cloud_points_mm` converts points.

SlicerROS2 differs: it scales the translations of `Pose` and `Transform` but leaves points, vectors
and twists in m.
"""

from collections.abc import Mapping
from types import MappingProxyType

from app.bridge.messages import MM_PER_M

Scale = float | tuple[float, ...]
"""Factor from the message's unit to ours: one for all numbers of the field, or one per number."""

_UNSCALED = 1.0


def _covariance() -> tuple[float, ...]:
    """Scales of a 6 x 6 covariance, row by row: three lengths, then three angles."""
    units = (MM_PER_M,) * 3 + (_UNSCALED,) * 3
    return tuple(row * column for row in units for column in units)


_POSE_COVARIANCE = _covariance()
_LINEAR_COVARIANCE = (MM_PER_M**2,) * 9

SCALES: Mapping[str, Mapping[str, Scale]] = MappingProxyType(
    {
        "geometry_msgs/msg/Point": {"x": MM_PER_M, "y": MM_PER_M, "z": MM_PER_M},
        "geometry_msgs/msg/Point32": {"x": MM_PER_M, "y": MM_PER_M, "z": MM_PER_M},
        "geometry_msgs/msg/Pose2D": {"x": MM_PER_M, "y": MM_PER_M},
        "geometry_msgs/msg/PoseWithCovariance": {"covariance": _POSE_COVARIANCE},
        "geometry_msgs/msg/Transform": {"translation": MM_PER_M},
        "geometry_msgs/msg/Twist": {"linear": MM_PER_M},
        "geometry_msgs/msg/TwistWithCovariance": {"covariance": _POSE_COVARIANCE},
        "geometry_msgs/msg/Accel": {"linear": MM_PER_M},
        "geometry_msgs/msg/AccelWithCovariance": {"covariance": _POSE_COVARIANCE},
        "geometry_msgs/msg/Inertia": {"com": MM_PER_M},
        "sensor_msgs/msg/Imu": {
            "linear_acceleration": MM_PER_M,
            "linear_acceleration_covariance": _LINEAR_COVARIANCE,
        },
        "sensor_msgs/msg/LaserEcho": {"echoes": MM_PER_M},
        "sensor_msgs/msg/LaserScan": {
            "range_min": MM_PER_M,
            "range_max": MM_PER_M,
            "ranges": MM_PER_M,
        },
        "sensor_msgs/msg/MultiEchoLaserScan": {"range_min": MM_PER_M, "range_max": MM_PER_M},
        "sensor_msgs/msg/Range": {
            "min_range": MM_PER_M,
            "max_range": MM_PER_M,
            "range": MM_PER_M,
            "variance": MM_PER_M**2,
        },
        "shape_msgs/msg/Plane": {"coef": (_UNSCALED, _UNSCALED, _UNSCALED, MM_PER_M)},
        "shape_msgs/msg/SolidPrimitive": {"dimensions": MM_PER_M},
        "stereo_msgs/msg/DisparityImage": {"t": MM_PER_M},
        "nav_msgs/msg/GridCells": {"cell_width": MM_PER_M, "cell_height": MM_PER_M},
        "nav_msgs/msg/MapMetaData": {"resolution": MM_PER_M},
        "visualization_msgs/msg/Marker": {"scale": MM_PER_M},
        "visualization_msgs/msg/InteractiveMarker": {"scale": MM_PER_M},
        "visualization_msgs/msg/ImageMarker": {
            "position": _UNSCALED,
            "points": _UNSCALED,
        },
        "moveit_msgs/msg/PositionConstraint": {"target_point_offset": MM_PER_M},
        "moveit_msgs/msg/VisibilityConstraint": {"target_radius": MM_PER_M},
        "moveit_msgs/srv/GetCartesianPath_Request": {
            "max_step": MM_PER_M,
            "prismatic_jump_threshold": MM_PER_M,
            "max_cartesian_speed": MM_PER_M,
        },
        "marginguard_msgs/msg/HalfSpace": {"offset": MM_PER_M, "tumor_velocity": MM_PER_M},
        "marginguard_msgs/msg/FixtureConstraint": {
            "free_distance": MM_PER_M,
            "max_tool_speed": MM_PER_M,
            "signed_distance": MM_PER_M,
            "lower_bound": MM_PER_M,
            "stop_distance": MM_PER_M,
            "warn_distance": MM_PER_M,
            "sigma_tre": MM_PER_M,
        },
        "marginguard_msgs/srv/Register_Response": {"fre": MM_PER_M},
        "marginguard_msgs/action/Replay_Result": {"min_signed_distance": MM_PER_M},
        "marginguard_msgs/action/Replay_Feedback": {"signed_distance": MM_PER_M},
    }
)
