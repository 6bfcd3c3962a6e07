"""Load ROS for a command, and publish a replay with it."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from app.files.extras import install_hint
from app.geometry import InputError

if TYPE_CHECKING:
    from app.runtime import ReplayRun


def load_ros(remark: str) -> None:
    """Import ROS, prepare its environment, and print the hosts that nodes can reach.

    Raises `InputError` without ROS; the message contains ``remark``. Raises `SecurityError` before
    anything is read if ROS security is asked for in vain.
    """
    try:
        from app.bridge import prepare_environment
        from app.bridge.environment import check_security
    except ImportError as error:
        raise InputError(
            f"ROS 2 cannot be loaded ({error}); expected an installed ROS 2, {remark}: "
            f"{install_hint(error)}"
        ) from error
    check_security()
    print(prepare_environment(), file=sys.stderr)


@contextmanager
def published(run: "ReplayRun", *, real_time: bool) -> Iterator[None]:
    """Within the context the steps of ``run`` are published and ROS controls its player."""
    load_ros("or --no-ros to replay without it")
    from app.bridge import replay_node

    with replay_node(run, real_time=real_time):
        yield
