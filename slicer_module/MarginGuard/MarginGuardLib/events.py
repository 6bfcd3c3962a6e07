"""Breaches and notes of the shown session: lists, jumps in a replay, a table in the scene."""

from slicer import vtkMRMLScene

from app.geometry import NS_PER_S, InputError
from app.runtime import AddNote
from app.session import BreachEntry, BreachList
from app.workflow import EventNote, EventNotes, WorkflowOutput

from .shown_session import ShownSession

MAX_ROWS = 50
"""Breaches in the panel: the deepest one, and the last ones."""
COLUMNS = ("time, s", "event", "depth, mm", "text")
Rows = tuple[tuple[str, ...], ...]


class SessionEvents:
    """Events of ``session``. Call it in the scene's thread."""

    def __init__(self, session: ShownSession, mrml_scene: vtkMRMLScene) -> None:
        self._session = session
        self._mrml_scene = mrml_scene
        self._notes = EventNotes()
        self._of: WorkflowOutput | None = None

    @property
    def breaches(self) -> BreachList:
        """Those of the whole recording in a replay, live those so far."""
        return self._session.breaches

    @property
    def notes(self) -> tuple[EventNote, ...]:
        """The notes on this session."""
        return self._notes.entries if self._of is self._session.workflow else ()

    def breach_rows(self) -> Rows:
        """Time, depth, place and part of the tool of each breach that is listed."""
        deepest = self.breaches.deepest
        return tuple(
            (
                f"{each.begin_s:.1f} s",
                f"{each.depth_mm:.1f} mm{' (deepest)' if each is deepest else ''}",
                each.place_text,
                each.tool_text,
            )
            for each in self._listed()
        )

    def note_rows(self) -> Rows:
        """Time and text of each note."""
        return tuple((f"{each.begin_s:.1f} s", each.text) for each in self.notes)

    def add_note(self, text: str) -> None:
        """Add a note on the step that is shown; live it is listed with the requests.

        Raises `InputError` for an empty or long text, and before the first step.
        """
        session = self._session
        step, workflow = session.shown_step, session.workflow
        if step is None or workflow is None:
            raise InputError("note: there is no step yet; expected one")
        if self._of is not workflow:
            self._notes, self._of = EventNotes(), workflow
        stamp_ns = step.frame.stamp.ns
        begin_s = (stamp_ns - self._begin_ns(workflow)) / NS_PER_S
        note = self._notes.add(step.index, stamp_ns, begin_s, text)
        if session.opened is None:
            line = f"{note.text} (step {note.frame}, stamp {note.stamp_ns} ns)"
            session.request(AddNote(line))

    def go_to_breach(self, row: int) -> None:
        """Show the deepest moment of the breach in ``row`` of a replay, paused."""
        listed = self._listed()
        if not 0 <= row < len(listed):
            raise InputError("breaches: none is selected; expected a row of the table")
        self._go_to(listed[row].deepest_ns)

    def go_to_note(self, row: int) -> None:
        """Show the moment of the note in ``row`` of a replay, paused."""
        if not 0 <= row < len(self.notes):
            raise InputError("notes: none is selected; expected a row of the table")
        self._go_to(self.notes[row].stamp_ns)

    def to_table(self) -> None:
        """Add a table of all events to the scene, which Slicer saves as CSV."""
        events = [
            (each.begin_s, "breach", f"{each.depth_mm:.2f}", f"{each.place_text}, {each.tool_text}")
            for each in self.breaches.entries
        ]
        events += [(each.begin_s, "note", "", each.text) for each in self.notes]
        if not events:
            raise InputError("events: there is none; expected a breach or a note")
        name = self._mrml_scene.GenerateUniqueName("Events")
        table = self._mrml_scene.AddNewNodeByClass("vtkMRMLTableNode", name)
        for column in COLUMNS:
            table.AddColumn().SetName(column)
        for begin_s, event, depth, text in sorted(events):
            row = table.AddEmptyRow()
            for column, cell in enumerate((f"{begin_s:.3f}", event, depth, text)):
                table.SetCellText(row, column, cell)

    def _listed(self) -> tuple[BreachEntry, ...]:
        listed = self.breaches.entries[-MAX_ROWS:]
        deepest = self.breaches.deepest
        if deepest is not None and deepest not in listed:
            listed = (deepest, *listed[1:])
        return listed

    def _begin_ns(self, workflow: WorkflowOutput) -> int:
        opened = self._session.opened
        return (workflow.begin_ns or 0) if opened is None else opened.extent.first_ns

    def _go_to(self, stamp_ns: int) -> None:
        first_ns = self._session.case().extent.first_ns
        self._session.seek((stamp_ns - first_ns) / NS_PER_S, paused=True)
