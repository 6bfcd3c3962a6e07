"""The definition of a message type as MCAP and rosbag2 carry it: its text and that of its parts."""

import re
from collections.abc import Sequence
from pathlib import Path

from app.geometry import InputError

_TYPE = re.compile(r"([a-z][a-z0-9_]*)/msg/([A-Z][A-Za-z0-9]*)")
_FIELD = re.compile(r"(?:([a-z][a-z0-9_]*)/(?:msg/)?)?([A-Z][A-Za-z0-9]*)(?:\[[^]]*\])?\s")
_SEPARATOR = "=" * 80


def message_definition(message_type: str, prefixes: Sequence[Path]) -> str:
    """The ``ros2msg`` schema of ``message_type`` (``package/msg/Name``).

    Definitions are looked for in ``share/PACKAGE/msg`` of each of ``prefixes``, where ROS
    packages install them; `InputError` for one that is in none.
    """
    texts: dict[str, str] = {}
    wanted = [message_type]
    for name in wanted:  # it grows while it is walked
        match = _TYPE.fullmatch(name)
        if match is None:
            raise InputError(f"message type {name!r}: package/msg/Name wanted")
        package = match[1]
        texts[name] = _text(package, match[2], prefixes)
        for line in texts[name].splitlines():
            field = _FIELD.match(line)
            part = field and f"{field[1] or package}/msg/{field[2]}"
            if part and part not in wanted:
                wanted.append(part)
    first, *others = wanted
    parts = [f"MSG: {name.replace('/msg/', '/')}\n{texts[name]}" for name in others]
    return f"\n{_SEPARATOR}\n".join([texts[first], *parts])


def _text(package: str, name: str, prefixes: Sequence[Path]) -> str:
    for prefix in prefixes:
        path = prefix / "share" / package / "msg" / f"{name}.msg"
        if path.is_file():
            return path.read_text(encoding="utf-8").rstrip()
    searched = ", ".join(str(prefix) for prefix in prefixes) or "nowhere"
    raise InputError(f"the definition of {package}/msg/{name} was not found ({searched})")
