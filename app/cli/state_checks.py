"""Check the folder that keeps the holds of live sessions, and what the next start finds there."""

import os
from pathlib import Path

from app.cli.system_checks import Check, checked

NAME = "live sessions"
_REMEDY = "a live session cannot start: make the folder writable, or set XDG_STATE_HOME"


def check_state(folder: Path) -> Check:
    """Check that records can be written to ``folder``; list its holds and sessions.

    A hold is no error: it is there to be seen by the next session and its operator.
    """
    if not _is_writable(folder):
        return checked(NAME, False, f"{folder} cannot be written", _REMEDY)
    texts = [_text_of(path) for path in sorted(folder.glob("domain*.json"))]
    found = [text for text in texts if text]
    return checked(NAME, True, "; ".join([str(folder), *found]), "")


def _is_writable(folder: Path) -> bool:
    existing = next((each for each in (folder, *folder.parents) if os.path.lexists(each)), None)
    return existing is not None and existing.is_dir() and os.access(existing, os.W_OK | os.X_OK)


def _text_of(path: Path) -> str:
    """The effect of this record on the next session; empty if it may start without hold."""
    from app.hold import SecondInstanceError, StateFileError
    from app.hold.on_disk import check_no_guard
    from app.hold.record import causes_of_record, read_any_record

    try:
        record = read_any_record(path)
    except StateFileError as error:
        return f"{error}: the next session begins on hold"
    slot = next((slot for slot in record.key.slots if slot.stem == path.stem), None)
    if slot is None:
        return f"{path.name}: not the record of its name: the next session begins on hold"
    try:
        check_no_guard(path.with_suffix(".lock"), slot)
    except SecondInstanceError:
        return f"{slot}: a session runs (process {record.pid})"
    causes = causes_of_record(record, None)
    return f"{slot}: the next session begins on hold ({causes[0]})" if causes else ""
