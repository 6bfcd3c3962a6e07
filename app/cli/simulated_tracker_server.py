"""The OpenIGTLink server of ``marginguard simulate --igtl``."""

from contextlib import nullcontext
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from contextlib import AbstractContextManager

    from app.igtl import PoseServer
    from app.simulation import WorldDescription


def check_names(port: int | None, description: "WorldDescription") -> None:
    """Raise `InputError` for a world whose tracker cannot be sent over OpenIGTLink."""
    from app.geometry import InputError, join_transform_name
    from app.igtl.tracked_poses import MAX_NAME_BYTES
    from app.simulation import TRACKER_FRAME

    if port is None:
        return
    if not 0 <= port < 1 << 16:
        raise InputError(f"--igtl is {port}; expected a port from 0 to 65535")
    if description.tracker is None:
        raise InputError("--igtl: the world has no tracker; expected one")
    for body in description.tracker.tracked:
        name = join_transform_name(body, TRACKER_FRAME)
        if len(name) > MAX_NAME_BYTES:
            raise InputError(
                f"--igtl: the name {name!r} has {len(name)} characters; expected at most "
                f"{MAX_NAME_BYTES}, as the protocol allows"
            )


def pose_server(port: int | None) -> "AbstractContextManager[PoseServer | None]":
    """The server on ``port``; None without one."""
    from app.igtl import PoseServer

    return nullcontext() if port is None else PoseServer(port)
