"""The notes as values for the page."""

from collections.abc import Sequence
from typing import Any

from app.viewer.readout.timeline import Timeline
from app.workflow.event_notes import EventNote

_MAX_ROWS = 50
"""Notes on the page: the last ones."""


def note_rows(notes: Sequence[EventNote], timeline: Timeline) -> list[dict[str, Any]]:
    """Number, time, text and frame of each note, and its place ``x`` on the timeline."""
    return [
        {
            "n": note.number,
            "frame": note.frame,
            "time": f"{note.begin_s:.1f} s",
            "text": note.text,
            "x": timeline.place(note),
        }
        for note in notes[-_MAX_ROWS:]
    ]
