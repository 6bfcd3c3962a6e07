"""The needle of the shown session, as the panel's user lengthens it."""

from app.runtime import OperatorCommands, longer_needle

from .events import THE_PANEL
from .shown_session import ShownSession


class PanelNeedle:
    """Length of the needle of ``session``. Call it in the scene's thread."""

    def __init__(self, session: ShownSession) -> None:
        self._session = session

    def lengthen(self, by_mm: float) -> None:
        """Show the needle longer by ``by_mm``. Raises `InputError` with why not."""
        self._session.commands().change_shown(longer_needle(by_mm), origin=THE_PANEL)

    def length(self) -> str:
        """The length in mm, empty without a needle."""
        thread = self._session.thread
        commands: OperatorCommands | None = None if thread is None else thread.run.commands
        needle = None if commands is None else commands.content.needle
        return "" if needle is None else f"{needle.length_mm:g}"
