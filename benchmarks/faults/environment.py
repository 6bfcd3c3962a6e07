"""Environment of the bench and of the programs that it starts."""

import os
from pathlib import Path

from app.bridge.environment import prepare_environment


def prepare(domain: int, folder: Path) -> None:
    """Set the ROS domain, and ``folder`` for state that the guard keeps; before ROS is loaded."""
    os.environ["ROS_DOMAIN_ID"] = str(domain)
    os.environ["XDG_STATE_HOME"] = str(folder / "state")
    prepare_environment()
