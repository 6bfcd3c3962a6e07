"""Event notes: one line each, numbered, limited."""

import pytest

from app.geometry import InputError
from app.workflow.workflow import MAX_NOTES, EventNotes


def test_note_is_one_printable_line_with_its_moment():
    notes = EventNotes()
    note = notes.add(12, 5_000, 3.25, "  specimen\nout\x00 ")
    assert (note.number, note.frame, note.stamp_ns, note.text) == (1, 12, 5_000, "specimen out?")
    assert note.line == "event at 3.25 s (frame 12): specimen out?"
    assert notes.entries == (note,)


@pytest.mark.parametrize("text", ["", " \n ", "x" * 201])
def test_empty_and_long_notes_are_refused(text):
    notes = EventNotes()
    with pytest.raises(InputError, match="expected 1 to 200"):
        notes.add(0, 0, 0.0, text)
    assert notes.entries == ()


def test_notes_are_limited():
    notes = EventNotes()
    for _ in range(MAX_NOTES):
        notes.add(0, 0, 0.0, "x")
    with pytest.raises(InputError, match="500; expected at most 500"):
        notes.add(0, 0, 0.0, "x")
