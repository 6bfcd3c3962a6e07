"""Definitions of message types as MCAP and rosbag2 store them, with those of nested types."""

import re
from collections.abc import Sequence
from pathlib import Path

from app.geometry import InputError

_TYPE = re.compile(r"([a-z][a-z0-9_]*)/msg/([A-Z][A-Za-z0-9]*)")
_FIELD = re.compile(r"(?:([a-z][a-z0-9_]*)/(?:msg/)?)?([A-Z][A-Za-z0-9]*)(?:\[[^]]*\])?\s")
_SEPARATOR = "=" * 80


def message_definition(message_type: str, prefixes: Sequence[Path]) -> str:
    """The ``ros2msg`` schema of ``message_type`` (``package/msg/Name``).

    ``prefixes``: installation folders of ROS packages, searched at ``share/PACKAGE/msg``. Raises
    `InputError` for a malformed type and for a definition that is in none of them.
    """
    texts: dict[str, str] = {}
    names = [message_type]
    for name in names:  # grows during the loop
        match = _TYPE.fullmatch(name)
        if match is None:
            raise InputError(f"message type is {name!r}; expected package/msg/Name")
        package = match[1]
        texts[name] = _text(package, match[2], prefixes)
        for line in texts[name].splitlines():
            field = _FIELD.match(line)
            part = field and f"{field[1] or package}/msg/{field[2]}"
            if part and part not in names:
                names.append(part)
    first, *others = names
    parts = [f"MSG: {name.replace('/msg/', '/')}\n{texts[name]}" for name in others]
    return f"\n{_SEPARATOR}\n".join([texts[first], *parts])


def _text(package: str, name: str, prefixes: Sequence[Path]) -> str:
    for prefix in prefixes:
        path = prefix / "share" / package / "msg" / f"{name}.msg"
        if path.is_file():
            return path.read_text(encoding="utf-8").rstrip()
    searched = ", ".join(str(prefix) for prefix in prefixes) or "nowhere"
    raise InputError(
        f"the definition of {package}/msg/{name} was not found; searched in {searched}"
    )
