"""The needle of the shown session, as the panel's user lengthens it."""

from app.runtime import LengthenNeedle

from .shown_session import ShownSession


class PanelNeedle:
    """Length of the needle of ``session``. Call it in the scene's thread."""

    def __init__(self, session: ShownSession) -> None:
        self._session = session

    def lengthen(self, by_mm: float) -> None:
        """Show the needle longer by ``by_mm``. Raises `InputError` without a session."""
        self._session.request(LengthenNeedle(by_mm))

    def length(self) -> str:
        """The length in mm, empty without a needle."""
        operator = self._session.operator
        needle = None if operator is None else operator.content.needle
        return "" if needle is None else f"{needle.length_mm:g}"
