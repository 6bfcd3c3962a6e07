"""Load ROS for a command."""

import sys

from app.files.extras import install_hint
from app.geometry import InputError


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
