"""The operator of a live session's page: which hold the page shows, and its re-arm."""

from concurrent.futures import Executor, Future
from contextlib import suppress

from app.geometry import MarginGuardError
from app.runtime import OperatorCommands, SeenHold

THE_PAGE = "the page"
"""Origin of its requests in the list of requests and in the audit log."""


class LiveOperator:
    """Sends re-arms of a page to a session. The page exists before the session: see `connect`.

    A re-arm waits for the session's step, so it runs in ``workers`` and not in the page's thread.
    Its outcome is in the session's list of requests, which the page shows.
    """

    def __init__(self, workers: Executor) -> None:
        self._workers = workers
        self._commands: OperatorCommands | None = None
        self._rearming: Future[None] | None = None

    def connect(self, commands: OperatorCommands) -> None:
        """Use the commands of a session from now on."""
        self._commands = commands

    def seen(self) -> SeenHold | None:
        """The hold of the constraint that was published last; None before `connect`."""
        return None if self._commands is None else self._commands.seen()

    def rearm(self, seen: SeenHold) -> None:
        """Begin to re-arm; returns at once. Does nothing while an earlier re-arm still runs."""
        if self._commands is None or (self._rearming is not None and not self._rearming.done()):
            return
        self._rearming = self._workers.submit(_rearm, self._commands, seen)


def _rearm(commands: OperatorCommands, seen: SeenHold) -> None:
    # A refusal is in the list of requests.
    with suppress(MarginGuardError):
        commands.rearm(seen, origin=THE_PAGE)
