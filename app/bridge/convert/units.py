"""The one table of units for messages of other people: field by field, from m to mm.

A message holds metres; plain values hold millimetres. A type is scaled wherever it occurs, in
other messages too: `Point` in `Pose`, `Pose` in `PoseArray`, and so on. `Vector3` has no unit by
itself, so whoever holds one says what it is. An entry for a field holds for all that is in it, and
comes before the entry of the field's own type (an `ImageMarker` has points in pixels).

Radians, seconds, newtons, newton metres, colours and plain numbers are as they are. So are
`JointState` and `JointTrajectory`, whose numbers are rad or m as the joint has it, and the bytes of
`Image` and `PointCloud2` (`app.bridge.convert.clouds` reads points in mm).

Where SlicerROS2 differs: it scales the translations of `Pose` and `Transform`, and leaves points,
vectors and twists in m, in one and the same scene.
"""

from collections.abc import Mapping
from types import MappingProxyType

from app.bridge.messages import MM_PER_M

Scale = float | tuple[float, ...]
"""mm for a m: one number for every number of the field, or one for each."""

_AS_IT_IS = 1.0


def _covariance() -> tuple[float, ...]:
    """6 x 6, row by row: three lengths, then three angles."""
    units = (MM_PER_M,) * 3 + (_AS_IT_IS,) * 3
    return tuple(row * column for row in units for column in units)


_SIX = _covariance()
_THREE = (MM_PER_M**2,) * 9

SCALES: Mapping[str, Mapping[str, Scale]] = MappingProxyType(
    {
        "geometry_msgs/msg/Point": {"x": MM_PER_M, "y": MM_PER_M, "z": MM_PER_M},
        "geometry_msgs/msg/Point32": {"x": MM_PER_M, "y": MM_PER_M, "z": MM_PER_M},
        "geometry_msgs/msg/Pose2D": {"x": MM_PER_M, "y": MM_PER_M},
        "geometry_msgs/msg/PoseWithCovariance": {"covariance": _SIX},
        "geometry_msgs/msg/Transform": {"translation": MM_PER_M},
        "geometry_msgs/msg/Twist": {"linear": MM_PER_M},
        "geometry_msgs/msg/TwistWithCovariance": {"covariance": _SIX},
        "geometry_msgs/msg/Accel": {"linear": MM_PER_M},
        "geometry_msgs/msg/AccelWithCovariance": {"covariance": _SIX},
        "geometry_msgs/msg/Inertia": {"com": MM_PER_M},
        "sensor_msgs/msg/Imu": {
            "linear_acceleration": MM_PER_M,
            "linear_acceleration_covariance": _THREE,
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
        "shape_msgs/msg/Plane": {"coef": (_AS_IT_IS, _AS_IT_IS, _AS_IT_IS, MM_PER_M)},
        "shape_msgs/msg/SolidPrimitive": {"dimensions": MM_PER_M},
        "stereo_msgs/msg/DisparityImage": {"t": MM_PER_M},
        "nav_msgs/msg/GridCells": {"cell_width": MM_PER_M, "cell_height": MM_PER_M},
        "nav_msgs/msg/MapMetaData": {"resolution": MM_PER_M},
        "visualization_msgs/msg/Marker": {"scale": MM_PER_M},
        "visualization_msgs/msg/InteractiveMarker": {"scale": MM_PER_M},
        "visualization_msgs/msg/ImageMarker": {
            "position": _AS_IT_IS,
            "points": _AS_IT_IS,
        },
        "marginguard_msgs/msg/HalfSpace": {"offset": MM_PER_M, "tumor_velocity": MM_PER_M},
        "marginguard_msgs/msg/FixtureConstraint": {
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
