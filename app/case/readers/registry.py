"""All recording formats, found in the modules of `app.case.readers`.

Loads neither numpy nor a reader: help texts list the formats.
"""

import importlib
import pkgutil
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import app.case.readers
from app.case.readers.recording_format import Note, RecordingFormat, SideTopics

if TYPE_CHECKING:
    from app.case.frames.samples import TrackingFrame

_NONE = SideTopics()
_NOT_FORMATS = ("recording_format", "registry")


def recording_formats() -> tuple[RecordingFormat, ...]:
    """Every format in the order in which they are tried: by module name, fallbacks last."""
    names = sorted(module.name for module in pkgutil.iter_modules(app.case.readers.__path__))
    found: list[RecordingFormat] = [
        importlib.import_module(f"app.case.readers.{name}").FORMAT
        for name in names
        if name not in _NOT_FORMATS
    ]
    return tuple(sorted(found, key=lambda each: each.is_fallback))


def recording_kinds() -> str:
    """The endings and folders of all formats, for messages and help texts."""
    return ", ".join(kind for each in recording_formats() for kind in each.kinds)


def format_of(path: Path) -> RecordingFormat:
    """The format of the recording at ``path``; `InputError` where none recognises it."""
    for each in recording_formats():
        if each.recognises(path):
            return each
    from app.geometry import InputError

    raise InputError(f"{path} is not a recording; expected one of {recording_kinds()}")


def read_recording(
    path: Path, note: Note, joints: SideTopics = _NONE, rate_hz: float | None = None
) -> "Iterator[TrackingFrame]":
    """Yield the frames of the recording at ``path``, in any of the formats.

    ``note`` takes what the reader skipped or assumed. ``rate_hz`` is that of a recording without
    times. Raises `InputError` for an unknown format, for a recording that cannot be read, and for a
    rate of a recording that has times.
    """
    found = format_of(path)
    if rate_hz is None:
        return found.read(path, note, joints)
    if found.read_at_rate is None:
        from app.geometry import InputError

        raise InputError(
            f"{path} has times of its own; expected no rate (recording.rate_hz, --rate-hz)"
        )
    return found.read_at_rate(path, note, rate_hz)
