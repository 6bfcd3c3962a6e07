"""Conversion between messages of any installed type and plain values in our units."""

from app.bridge.convert.clouds import cloud_array, cloud_message, cloud_points_mm
from app.bridge.convert.collision_objects import collision_object, removed_object
from app.bridge.convert.errors import ConversionError, UnknownTypeError
from app.bridge.convert.images import image_array, image_message
from app.bridge.convert.plain import from_plain, to_plain
from app.bridge.convert.qos_profile import qos_profile
from app.bridge.convert.queue import TopicQueue
from app.bridge.convert.topics import TopicPublisher, TopicSubscriber
from app.bridge.convert.types import action_type, message_type, service_type, type_name

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
