"""Convert a received ``marginguard_msgs/FixtureConstraint`` to plain values, in mm and mm/s."""

import numpy as np
from builtin_interfaces.msg import Time
from marginguard_msgs.msg import FixtureConstraint

from app.bridge.messages import MM_PER_M
from app.fixture import PlainConstraint
from app.geometry import NS_PER_S, FloatArray


def plain_constraint(message: FixtureConstraint) -> PlainConstraint:
    """The values of ``message`` that `app.fixture.FixtureRule` needs; nothing is checked."""
    planes = message.half_spaces
    return PlainConstraint(
        instance_id=message.instance_id,
        seq=message.seq,
        frame=message.header.frame_id,
        stamp_ns=_ns(message.header.stamp),
        valid_until_ns=_ns(message.valid_until),
        state=message.state,
        hold=message.hold,
        simulated=message.simulated,
        planes_current=message.planes_current,
        normals=_vectors([plane.normal for plane in planes]),
        offsets_mm=MM_PER_M * np.array([plane.offset for plane in planes]),
        points_on_tool_mm=MM_PER_M * _vectors([plane.point_on_tool for plane in planes]),
        tumor_velocities_mm_s=MM_PER_M * _vectors([plane.tumor_velocity for plane in planes]),
        free_distance_mm=MM_PER_M * message.free_distance,
        free_turn_rad=message.free_turn,
        max_tool_speed_mm_s=MM_PER_M * message.max_tool_speed,
        max_tool_turn_rad_s=message.max_tool_turn,
        setup_id=message.setup_id,
    )


def _vectors(values: list[object]) -> FloatArray:
    """``Vector3`` or ``Point`` messages as an array (k, 3)."""
    return np.array([(each.x, each.y, each.z) for each in values]).reshape(-1, 3)  # type: ignore[attr-defined]


def _ns(time: Time) -> int:
    return int(time.sec * NS_PER_S + time.nanosec)
