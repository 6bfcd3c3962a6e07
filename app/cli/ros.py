"""Load ROS for a command, and publish a replay with it."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from app.files.extras import install_hint
from app.geometry import InputError

if TYPE_CHECKING:
    from app.runtime import ReplayRun


def load_bridge(remark: str) -> None:
    """Import ROS. Raises `InputError` without it; the message contains ``remark``."""
    try:
        import app.bridge  # noqa: F401
    except ImportError as error:
        raise InputError(
            f"ROS 2 cannot be loaded ({error}); expected an installed ROS 2, {remark}: "
            f"{install_hint(error)}"
        ) from error


def print_reach() -> None:
    """Prepare the environment for ROS, and print the hosts that nodes of this process can reach.

    Raises `SecurityError` before anything is read if ROS security is asked for in vain.
    """
    from app.bridge import prepare_environment
    from app.bridge.environment import check_security

    check_security()
    print(prepare_environment(), file=sys.stderr)


@contextmanager
def published(run: "ReplayRun", *, real_time: bool) -> Iterator[None]:
    """Within the context the steps of ``run`` are published and ROS controls its player."""
    load_bridge("or --no-ros to replay without it")
    print_reach()
    from app.bridge import replay_node

    with replay_node(run, real_time=real_time):
        yield
