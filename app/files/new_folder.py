"""A folder that appears whole or not at all."""

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from app.geometry import InputError


@contextmanager
def new_folder(folder: Path) -> Iterator[Path]:
    """What is written to the folder that is given becomes ``folder`` where nothing was raised.

    Raises `InputError` where ``folder`` is there already, and where it cannot be written: nothing
    is left of it then.
    """
    if os.path.lexists(folder):
        raise InputError(f"{folder} is there already: it is not written over")
    partial = folder.with_name(f".{folder.name}.partial")
    try:
        partial.mkdir(parents=True)
    except OSError as error:
        raise InputError(f"{folder} cannot be written: {error.strerror} ({partial})") from error
    try:
        yield partial
        partial.rename(folder)
    except OSError as error:
        raise InputError(f"{folder} cannot be written: {error}") from error
    finally:
        shutil.rmtree(partial, ignore_errors=True)
