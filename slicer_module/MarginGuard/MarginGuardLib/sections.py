"""The parts of the panel that have a class of their own."""

from collections.abc import Callable
from typing import Any

from .contour_section import ContourSection
from .events import SessionEvents
from .events_section import EventsSection
from .guided_section import GuidedSection
from .needle_section import NeedleSection
from .status import PanelStatus
from .ultrasound_section import UltrasoundSection


class Sections:
    """Connects and shows all of them.

    ``on_click(button, command)`` has ``command(panel_logic)`` called at each click.
    """

    def __init__(self, ui: Any, on_click: Callable[[Any, Callable[[Any], object]], None]) -> None:
        self._guided = GuidedSection(ui, on_click)
        self._events = EventsSection(ui, on_click)
        self._contour = ContourSection(ui, on_click)
        self._needle = NeedleSection(ui, on_click)
        self._ultrasound = UltrasoundSection(ui, on_click)

    def show(self, status: PanelStatus, events: SessionEvents) -> None:
        """Show ``status`` and what ``events`` lists now."""
        self._guided.show(status)
        self._contour.show(status.contour, status.stylus)
        self._needle.show(status.needle, is_live=status.is_live)
        self._ultrasound.show(status.ultrasound)
        self._events.show(
            events,
            has_session=status.has_session and bool(status.workflow),
            is_replay=status.position_s is not None,
        )
