"""Lists of the page: breaches, notes, steps of the case."""

from collections.abc import Sequence
from typing import Any

from app.runtime import RecordingStatus
from app.session import BreachList, moment_text
from app.viewer.timeline import Timeline
from app.viewer.view_state import ViewState
from app.workflow import CalibrationStatus, WorkflowState, next_step, workflow_steps
from app.workflow.workflow import EventNote

_MAX_ROWS = 50
"""The deepest breach and the last ones are listed, and the last notes."""


def breach_rows(breaches: BreachList) -> dict[str, Any]:
    """The number of breaches, and of each that is listed its time, depth, place and tool part."""
    deepest = breaches.deepest
    listed = breaches.entries[-_MAX_ROWS:]
    if deepest is not None and deepest not in listed:
        listed = (deepest, *listed[1:])
    return {
        "count": breaches.count,
        "rows": [
            {
                "n": entry.number,
                "frame": entry.deepest,
                "first": entry.first,
                "time": moment_text(entry.begin_ns, entry.begin_s),
                "depth": f"{entry.depth_mm:.1f} mm",
                "place": entry.place_text,
                "letters": entry.place,
                "part": entry.tool_text,
                "deepest": entry is deepest,
                "open": entry.is_open,
            }
            for entry in listed
        ],
    }


def note_rows(notes: Sequence[EventNote], timeline: Timeline) -> list[dict[str, Any]]:
    """Number, time, text and frame of each note, and its place ``x`` on the timeline."""
    return [
        {
            "n": note.number,
            "frame": note.frame,
            "time": moment_text(note.stamp_ns, note.begin_s),
            "text": note.text,
            "x": timeline.place(note),
        }
        for note in notes[-_MAX_ROWS:]
    ]


def workflow_values(
    shown: ViewState | None,
    *,
    is_live: bool,
    has_images: bool,
    calibration: CalibrationStatus | None,
    recording: RecordingStatus | None,
) -> dict[str, Any] | None:
    """Each step with what it needs, has and lacks; None before the first moment of a session."""
    if shown is None:
        return None
    steps = workflow_steps(
        shown.step,
        shown.content,
        is_live=is_live,
        silent=shown.silent,
        has_images=has_images,
        calibration=calibration,
        recording=recording,
    )
    following = next_step(steps)
    needed = [each for each in steps if each.is_needed]
    done = sum(each.state is WorkflowState.DONE for each in needed)
    return {
        "count": f"{done} of {len(needed)} done",
        "next": "" if following is None else following.name.value,
        "rows": [
            {
                "name": each.name.value,
                "state": each.state.value,
                "symbol": each.symbol,
                "needs": each.needs,
                "has": each.has,
                "problem": each.problem,
            }
            for each in steps
        ],
    }
