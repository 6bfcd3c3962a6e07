"""Shared parts of the tests' independent ROS processes; plain rclpy, not the project."""

import contextlib
from importlib import import_module

import rclpy
from rclpy.executors import ExternalShutdownException


def interface(name):
    """The class of ``package/folder/Type``."""
    package, folder, kind = name.split("/")
    return getattr(import_module(f"{package}.{folder}"), kind)


def as_plain(value):
    """A message as dicts, lists, numbers and texts."""
    if hasattr(value, "get_fields_and_field_types"):
        return {name: as_plain(getattr(value, name)) for name in value.get_fields_and_field_types()}
    if isinstance(value, bytes):
        return value[0] if len(value) == 1 else list(value)
    if isinstance(value, str | int | float | bool):
        return value
    if hasattr(value, "tolist"):
        return value.tolist()
    return [as_plain(item) for item in value]


def filled(message, fields):
    """``message`` with these fields; a dict is a nested message, a list of dicts several."""
    kinds = message.get_fields_and_field_types()
    for name, value in fields.items():
        if isinstance(value, dict):
            filled(getattr(message, name), value)
        elif isinstance(value, list) and value and isinstance(value[0], dict):
            package, kind = kinds[name].removeprefix("sequence<").rstrip(">").split("/")
            each = interface(f"{package}/msg/{kind}")
            setattr(message, name, [filled(each(), item) for item in value])
        else:
            setattr(message, name, value)
    return message


def stamped(message, ns):
    """``message`` with the stamp ``ns``."""
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(ns, 10**9)
    return message


def edge_message(message, parent, child, translation_m, quaternion, ns):
    """``message``, a transform with a header, with these values."""
    message.header.frame_id, message.child_frame_id = parent, child
    move, turn = message.transform.translation, message.transform.rotation
    move.x, move.y, move.z = translation_m
    turn.x, turn.y, turn.z, turn.w = map(float, quaternion)
    return stamped(message, ns)


def spin(node):
    """Spin until the context is shut down, by SIGTERM or by the process."""
    with contextlib.suppress(ExternalShutdownException, KeyboardInterrupt):
        rclpy.spin(node)
