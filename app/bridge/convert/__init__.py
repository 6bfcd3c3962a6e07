"""Messages of any installed type as plain values, in our units, and back."""

from app.bridge.convert.errors import ConversionError, UnknownTypeError
from app.bridge.convert.types import action_type, message_type, service_type, type_name

__all__ = [
    "ConversionError",
    "UnknownTypeError",
    "action_type",
    "message_type",
    "service_type",
    "type_name",
]
