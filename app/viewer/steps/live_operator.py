"""The operator of a live session's page: which hold the page shows, its re-arm, its tumour."""

from collections.abc import Callable
from concurrent.futures import Executor, Future
from contextlib import suppress
from typing import Any, TypeVar

from app.geometry import MarginGuardError, SurfaceMesh, Transform
from app.runtime import OperatorCommands, RequestKind, SeenHold

_Value = TypeVar("_Value")

THE_PAGE = "the page"
"""Origin of its requests in the list of requests and in the audit log."""


class LiveOperator:
    """Sends requests of a page to a session. The page exists before the session: see `connect`.

    A request waits for the session's step, so it runs in ``workers`` and not in the page's thread;
    with two workers a re-arm does not wait for a tumour. Its outcome is in the session's list of
    requests, which the page shows.
    """

    def __init__(self, workers: Executor) -> None:
        self._workers = workers
        self._commands: OperatorCommands | None = None
        self._rearming: Future[None] | None = None
        self._replacing: Future[None] | None = None

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

    def compute(self, function: Callable[..., _Value], /, *args: Any) -> _Value:
        """Return ``function(*args)``, computed where it does not delay the session."""
        return (
            function(*args) if self._commands is None else self._commands.compute(function, *args)
        )

    def set_tumor(self, frame_from_tumor: Transform, tumor: SurfaceMesh, sigma_mm: float) -> bool:
        """Begin to replace the tumour; False before `connect` and while an earlier one runs."""
        if self._commands is None or (self._replacing is not None and not self._replacing.done()):
            return False
        self._replacing = self._workers.submit(
            _set_tumor, self._commands, frame_from_tumor, tumor, sigma_mm
        )
        return True


def _set_tumor(
    commands: OperatorCommands, edge: Transform, tumor: SurfaceMesh, sigma_mm: float
) -> None:
    with suppress(MarginGuardError):
        commands.requests.admit(RequestKind.TUMOR)
        commands.set_tumor(edge, tumor, sigma_mm=sigma_mm, origin=THE_PAGE)


def _rearm(commands: OperatorCommands, seen: SeenHold) -> None:
    # A refusal is in the list of requests.
    with suppress(MarginGuardError):
        commands.rearm(seen, origin=THE_PAGE)
