"""``.xacro`` files to URDF by the xacro package, in a process of its own with limits.

xacro evaluates Python expressions (``${...}``, ``$(eval ...)``). It hides the builtins from them,
but this is not a sandbox: a xacro file is code. So only a file that the user names is expanded,
never a text from the network, and the process has limits of time and memory (`xacro_child`).
Included files, those of ``xacro.load_yaml`` too, must lie, with links followed, in the folder of
the file's package (its own folder where it has none) or in that of a package found by
``$(find ...)``. Document types are refused.
"""

import json
import os
import signal
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path

from app.files.child_process import Ask, ChildError, ask
from app.robot.description.urdf import MAX_URDF_BYTES
from app.robot.errors import UrdfError

MAX_CPU_S = 1.5
"""Limit for the processor time of an expansion; those of real robots take 0.05 to 0.5 s."""

MAX_WALL_S = 30.0
"""Limit for the time of an expansion on a machine that is busy with other things."""

_ASK = partial(ask, "app.robot.description.xacro_child", max_s=MAX_WALL_S)


def parse_xacro_args(entries: list[str]) -> dict[str, str]:
    """Parse ``["name:=value", ...]``; raise `UrdfError` for an entry of another form."""
    arguments: dict[str, str] = {}
    for entry in entries:
        name, sign, value = entry.partition(":=")
        if not sign or not name.strip():
            raise UrdfError(f"xacro argument is {entry!r}; expected name:=value")
        arguments[name.strip()] = value
    return arguments


def expand_xacro(
    path: Path,
    arguments: Mapping[str, str],
    package_dirs: Sequence[str | Path] = (),
    *,
    ask: Ask = _ASK,
) -> bytes:
    """Expand the xacro file at ``path`` to URDF.

    ``arguments`` are the values of its ``<xacro:arg>``. ``package_dirs`` are the folders of
    ``$(find NAME)``. Raises `UrdfError` when the expansion fails, or exceeds a limit of
    `xacro_child`.
    """
    request = {
        "path": str(path.absolute()),
        "arguments": dict(arguments),
        "package_dirs": [os.fspath(entry) for entry in package_dirs],
        "max_bytes": MAX_URDF_BYTES,
        "max_cpu_s": MAX_CPU_S,
    }
    try:
        status, reply = ask(json.dumps(request).encode())
    except ChildError as problem:
        raise UrdfError(f"{path} cannot be expanded: xacro {problem}") from problem
    if status == -signal.SIGPROF:
        raise UrdfError(
            f"{path} cannot be expanded: it takes more than {MAX_CPU_S:g} s of processor time; "
            "expand a large file once by 'xacro' and give the URDF"
        )
    if status != 0 or reply[:1] not in (b"U", b"E"):
        raise UrdfError(f"{path} cannot be expanded: xacro ended with status {status}")
    if reply[:1] == b"E":
        raise UrdfError(reply[1:].decode("utf-8", "replace"))
    return reply[1:]
