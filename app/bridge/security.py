"""Refuse to run unprotected where ROS security (SROS2, DDS-Security) is asked for.

The Fast DDS of the ROS 2 wheels is compiled without its security plugins. Then ROS itself stops
with an internal error in some configurations, and runs unprotected in others: it reads no other
value of ``ROS_SECURITY_ENABLE`` than ``true``, and without ``ROS_SECURITY_STRATEGY=Enforce`` a
participant without keys joins unprotected.
"""

import os
import re
from collections.abc import Iterable, Mapping
from pathlib import Path

from app.bridge.errors import BridgeError

ENABLE = "ROS_SECURITY_ENABLE"
STRATEGY = "ROS_SECURITY_STRATEGY"
KEYSTORE = "ROS_SECURITY_KEYSTORE"

_ENFORCE = "Enforce"
_WITHOUT_PLUGINS = b"doesn't have the security libraries"
"""Text of rmw_fastrtps that it contains only if it was compiled without security."""

_FAST_DDS = re.compile(r"librmw_fastrtps_shared_cpp\.so")
_MAPPED = Path("/proc/self/maps")


class SecurityError(BridgeError):
    """Security is asked for and cannot be had, or not as asked for."""


def check_security(*, required: bool = False, environment: Mapping[str, str] = os.environ) -> None:
    """Raise `SecurityError` if security is asked for and this process would not have it.

    It is asked for by ``ROS_SECURITY_ENABLE`` with any value but ``false``, and by ``required``
    (``security: required`` in live.yaml), which then needs the variables as well. Call it before
    the first node. Loads the middleware.
    """
    enable = environment.get(ENABLE, "")
    if enable in ("", "false") and not required:
        return
    problem = _problem_of_settings(environment)
    if problem:
        asked = "security: required" if enable in ("", "false") else f"{ENABLE}={enable}"
        raise SecurityError(f"ROS security: asked for by {asked}, but {problem}")
    library = library_without_security()
    if library is not None:
        raise SecurityError(
            f"ROS security: asked for, but {library.name} is compiled without it, as all ROS 2 "
            "wheels are; expected a desktop installation of ROS (docs/security_ros.md), or "
            f"{ENABLE}=false to run unprotected"
        )


def _problem_of_settings(environment: Mapping[str, str]) -> str:
    enable, strategy = environment.get(ENABLE, ""), environment.get(STRATEGY, "")
    if enable != "true":
        return f"{ENABLE} is {enable!r}; expected 'true', the only value that ROS reads"
    if strategy != _ENFORCE:
        return (
            f"{STRATEGY} is {strategy!r}; expected {_ENFORCE!r}: with any other value ROS runs "
            "unprotected without keys"
        )
    keystore = environment.get(KEYSTORE, "")
    if not keystore or not Path(keystore, "enclaves").is_dir():
        return f"{KEYSTORE} is {keystore!r}; expected the folder of a keystore with 'enclaves'"
    return ""


def library_without_security(libraries: Iterable[Path] | None = None) -> Path | None:
    """The loaded middleware if it is compiled without security; None if it has it or is unknown.

    Another middleware than Fast DDS is not recognised: with ``Enforce`` ROS itself refuses to start
    where its security is missing. ``libraries`` replaces the shared libraries of this process.
    """
    for library in _loaded_libraries() if libraries is None else libraries:
        if _FAST_DDS.match(library.name) and _WITHOUT_PLUGINS in library.read_bytes():
            return library
    return None


def _loaded_libraries() -> list[Path]:
    """Shared libraries of this process after the middleware was loaded."""
    from rclpy.utilities import get_rmw_implementation_identifier

    get_rmw_implementation_identifier()
    try:
        lines = _MAPPED.read_text().splitlines()
    except OSError:
        return []
    names = {line.split(maxsplit=5)[5] for line in lines if line.count("/")}
    return sorted(Path(name) for name in names if name.startswith("/"))
