"""Conversion between messages of any installed type and plain values in our units."""

from app.bridge.convert.array_messages import (
    cloud_array,
    cloud_message,
    cloud_points_mm,
    collision_object,
    image_array,
    image_message,
    removed_object,
)
from app.bridge.convert.generic_topics import (
    TopicPublisher,
    TopicQueue,
    TopicSubscriber,
    qos_profile,
)
from app.bridge.convert.plain import (
    action_type,
    from_plain,
    message_type,
    service_type,
    to_plain,
    type_name,
)
from app.bridge.ros_errors import ConversionError, UnknownTypeError

__all__ = [
    "ConversionError",
    "TopicPublisher",
    "TopicQueue",
    "TopicSubscriber",
    "UnknownTypeError",
    "action_type",
    "cloud_array",
    "cloud_message",
    "cloud_points_mm",
    "collision_object",
    "from_plain",
    "image_array",
    "image_message",
    "message_type",
    "qos_profile",
    "removed_object",
    "service_type",
    "to_plain",
    "type_name",
]
