"""A message as YAML text, in the form of ``ros2 topic echo``."""

from array import array
from typing import Any

import numpy as np
import yaml


def yaml_text(message: Any) -> str:
    """YAML of ``message`` with its own units (m)."""
    text: str = yaml.safe_dump(_plain(message), sort_keys=False, allow_unicode=True)
    return text


def _plain(value: Any) -> Any:
    if hasattr(value, "get_fields_and_field_types"):
        return {
            field: _plain(getattr(value, field)) for field in value.get_fields_and_field_types()
        }
    if isinstance(value, np.ndarray | array):
        return value.tolist()
    if isinstance(value, list | tuple):
        return [_plain(each) for each in value]
    if isinstance(value, bytes):
        return list(value)
    return value.item() if isinstance(value, np.generic) else value
