"""The widgets of breaches and notes."""

from collections.abc import Callable
from typing import Any

from .events import SessionEvents
from .table import fill_table


class EventsSection:
    """Connects the buttons, and shows the lists.

    ``on_click(button, command)`` has ``command(panel_logic)`` called at each click.
    """

    def __init__(self, ui: Any, on_click: Callable[[Any, Callable[[Any], object]], None]) -> None:
        self._ui = ui
        breaches, notes = ui.breachTableWidget, ui.noteTableWidget
        for button, command in (
            (ui.goToBreachButton, lambda logic: logic.events.go_to_breach(breaches.currentRow())),
            (ui.goToNoteButton, lambda logic: logic.events.go_to_note(notes.currentRow())),
            (ui.addNoteButton, self._add_note),
            (ui.eventsTableButton, lambda logic: logic.events.to_table()),
        ):
            on_click(button, command)

    def show(self, events: SessionEvents, *, has_session: bool, is_replay: bool) -> None:
        """Show what ``events`` lists now."""
        ui = self._ui
        breaches, notes = events.breach_rows(), events.note_rows()
        ui.breachLabel.setText(events.breaches.text or "no breach")
        fill_table(ui.breachTableWidget, breaches)
        fill_table(ui.noteTableWidget, notes)
        ui.goToBreachButton.setEnabled(is_replay and bool(breaches))
        ui.goToNoteButton.setEnabled(is_replay and bool(notes))
        ui.addNoteButton.setEnabled(has_session)
        ui.eventsTableButton.setEnabled(bool(breaches or notes))

    def _add_note(self, logic: Any) -> None:
        logic.events.add_note(self._ui.noteLineEdit.property("text"))
        self._ui.noteLineEdit.setText("")
