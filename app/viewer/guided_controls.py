"""Commands of the page that every guided recording has; each names the revision it has seen."""

from collections.abc import Callable
from typing import Any, Generic, Protocol, TypeVar

from app.geometry import InputError
from app.viewer.messages.checks import integer
from app.viewer.messages.commands import Commands
from app.viewer.messages.errors import NotDoneError

seen_revision = integer(0, 2**53 - 1)


class Guide(Protocol):
    """A guided recording whose result the session can use."""

    def stop(self, seen: int) -> None:
        """End the recording."""

    def discard(self, seen: int) -> None:
        """Drop the recording."""

    def accept(self, seen: int, use: Any) -> None:
        """Request by ``use`` that the session uses the result."""

    def undo(self, seen: int, use: Any) -> None:
        """Request by ``use`` what the session used before."""


class GuidedPart(Protocol):
    """The part of the page with a guide; ``use`` replaces what the session uses."""

    @property
    def guide(self) -> Guide:
        """The recording."""

    @property
    def use(self) -> Callable[..., bool]:
        """Begins to use a result in the session."""


_Part = TypeVar("_Part", bound=GuidedPart)


class GuidedControls(Generic[_Part]):
    """Stop, discard, use the result, undo, as the commands ``NAME_stop`` to ``NAME_undo``.

    A command that cannot be done, also because another page has changed the recording, raises
    `NotDoneError`: the page that asked shows its text, and nothing has changed.
    """

    def __init__(
        self, name: str, commands: Commands, part: _Part, changed: Callable[[], None]
    ) -> None:
        self._part = part
        self._changed = changed
        commands.add(f"{name}_stop", self._stop, seen_revision)
        commands.add(f"{name}_discard", self._discard, seen_revision)
        commands.add(f"{name}_use", self._use, seen_revision)
        commands.add(f"{name}_undo", self._undo, seen_revision)

    def _stop(self, seen: int) -> None:
        self._do(lambda: self._part.guide.stop(seen))

    def _discard(self, seen: int) -> None:
        self._do(lambda: self._part.guide.discard(seen))

    def _use(self, seen: int) -> None:
        self._do(lambda: self._part.guide.accept(seen, self._part.use))

    def _undo(self, seen: int) -> None:
        self._do(lambda: self._part.guide.undo(seen, self._part.use))

    def _do(self, change: Callable[[], None]) -> None:
        try:
            change()
        except InputError as error:
            raise NotDoneError(str(error)) from error
        self._changed()
