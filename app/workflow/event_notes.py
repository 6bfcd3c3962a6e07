"""Notes of operators on moments of a session, in the order in which they were written."""

from dataclasses import dataclass

from app.geometry import InputError

MAX_NOTES = 500
MAX_CHARS = 200


@dataclass(frozen=True, slots=True)
class EventNote:
    """Note ``number`` on the step ``frame``, whose stamp is ``stamp_ns`` on the tracker's clock.

    ``begin_s``: time since the first step.
    """

    number: int
    frame: int
    stamp_ns: int
    begin_s: float
    text: str

    @property
    def line(self) -> str:
        """One line for a report."""
        return f"event at {self.begin_s:.2f} s (frame {self.frame}): {self.text}"


class EventNotes:
    """The notes of a session. The page's thread adds; other threads may read `entries`."""

    def __init__(self) -> None:
        self.entries: tuple[EventNote, ...] = ()

    def add(self, frame: int, stamp_ns: int, begin_s: float, text: str) -> EventNote:
        """Add a note. Raises `InputError` for an empty or long text, and above `MAX_NOTES`."""
        line = " ".join(text.split())
        line = "".join(each if each.isprintable() else "?" for each in line)
        if not line or len(line) > MAX_CHARS:
            raise InputError(f"note: {len(line)} characters; expected 1 to {MAX_CHARS}")
        if len(self.entries) >= MAX_NOTES:
            raise InputError(f"notes: {len(self.entries)}; expected at most {MAX_NOTES}")
        note = EventNote(len(self.entries) + 1, frame, stamp_ns, begin_s, line)
        self.entries = (*self.entries, note)
        return note
