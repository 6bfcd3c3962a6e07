"""Folder of the files that MarginGuard keeps from one live session to the next."""

import os
from collections.abc import Mapping
from pathlib import Path

from app.geometry import InputError

STATE_HOME = "XDG_STATE_HOME"


def state_folder(environment: Mapping[str, str] = os.environ) -> Path:
    """``$XDG_STATE_HOME/marginguard``, by default ``~/.local/state/marginguard``; may not exist.

    As the XDG Base Directory Specification demands, a relative XDG_STATE_HOME is ignored. Raises
    `InputError` for a user without a home folder.
    """
    given = environment.get(STATE_HOME, "")
    if Path(given).is_absolute():
        return Path(given) / "marginguard"
    try:
        return Path.home() / ".local" / "state" / "marginguard"
    except RuntimeError as error:
        raise InputError(f"{STATE_HOME}: {error}; expected the path of a folder") from error
