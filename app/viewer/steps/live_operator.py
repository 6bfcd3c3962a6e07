"""The operator of a live session's page: the hold that it shows, and what it may request."""

from collections.abc import Callable
from concurrent.futures import Executor, Future
from contextlib import suppress
from typing import Any, TypeVar

from app.geometry import MarginGuardError, SurfaceMesh, Transform
from app.registration import RegistrationResult
from app.runtime import (
    ImageDepth,
    OperatorCommands,
    RecordingStatus,
    RequestKind,
    SeenHold,
    ShownChange,
    TipChange,
    tip_request_kind,
    use_tip,
)

_Value = TypeVar("_Value")
UseMargins = Callable[[float, float, str], None]

THE_PAGE = "the page"
"""Origin of its requests in the list of requests and in the audit log."""


class LiveOperator:
    """Sends requests of a page to a session. The page exists before the session: see `connect`.

    A request waits for the session's step, so it runs in ``workers`` and not in the page's thread;
    with three workers a re-arm does not wait for a tumour or a recorder. Its outcome is in the
    session's list of requests, which the page shows.
    """

    def __init__(self, workers: Executor) -> None:
        self._workers = workers
        self._commands: OperatorCommands | None = None
        self._use_margins: UseMargins | None = None
        self._rearming: Future[None] | None = None
        self._replacing: Future[None] | None = None
        self._recording: Future[None] | None = None
        self._calibrating: Future[None] | None = None
        self._registering: Future[None] | None = None

    def connect(self, commands: OperatorCommands, use_margins: UseMargins | None = None) -> None:
        """Use the commands of a session from now on.

        ``use_margins(stop_mm, warn_mm, origin)`` changes its margins where they are kept.
        """
        self._commands, self._use_margins = commands, use_margins

    def seen(self) -> SeenHold | None:
        """The hold of the constraint that was published last; None before `connect`."""
        return None if self._commands is None else self._commands.seen()

    def rearm(self, seen: SeenHold) -> None:
        """Begin to re-arm; returns at once. Does nothing while an earlier re-arm still runs."""
        if self._commands is None or (self._rearming is not None and not self._rearming.done()):
            return
        self._rearming = self._workers.submit(_rearm, self._commands, seen)

    @property
    def margins(self) -> tuple[float, float] | None:
        """Stop and warning distance in mm that are in use; None before `connect`."""
        if self._commands is None:
            return None
        margins = self._commands.content.margins
        return margins.stop_mm, margins.warn_mm

    def set_margins(self, stop_mm: float, warn_mm: float) -> bool:
        """Begin to change the margins; False before `connect`. Looser ones latch a hold."""
        if self._commands is None or self._use_margins is None:
            return False
        self._workers.submit(_set_margins, self._commands, self._use_margins, stop_mm, warn_mm)
        return True

    @property
    def recording(self) -> RecordingStatus | None:
        """What the last recording has written; None before the first."""
        return None if self._commands is None else self._commands.recording

    def record(self, start: bool, name: str = "") -> bool:
        """Begin to start or stop a recording; False while another such request runs."""
        if self._commands is None or (self._recording is not None and not self._recording.done()):
            return False
        self._recording = self._workers.submit(_record, self._commands, start, name)
        return True

    def note(self, text: str) -> None:
        """List a note on the present with the requests: in the audit log and on the page."""
        if self._commands is not None:
            self._commands.requests.accepted(RequestKind.NOTE, THE_PAGE, text)

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

    @property
    def image_depth(self) -> ImageDepth | None:
        """The depths of the images; None before `connect`, and for a session without several."""
        return None if self._commands is None else self._commands.content.image_depth

    def change_shown(self, request: tuple[RequestKind, ShownChange]) -> bool:
        """Begin to change what is shown (`app.runtime.shown_changes`); False before `connect`."""
        if self._commands is None:
            return False
        self._workers.submit(_change_shown, self._commands, request)
        return True

    def set_tip(self, change: TipChange) -> bool:
        """Begin to use a tip; False before `connect` and while an earlier request runs."""
        running = self._calibrating is not None and not self._calibrating.done()
        if self._commands is None or running:
            return False
        self._calibrating = self._workers.submit(_set_tip, self._commands, change)
        return True

    def set_registration(self, result: RegistrationResult) -> bool:
        """Begin to use a registration; False before `connect` and while an earlier request runs."""
        running = self._registering is not None and not self._registering.done()
        if self._commands is None or running:
            return False
        self._registering = self._workers.submit(_set_registration, self._commands, result)
        return True


def _set_margins(
    commands: OperatorCommands, use: UseMargins, stop_mm: float, warn_mm: float
) -> None:
    try:
        commands.requests.admit(RequestKind.MARGINS)
        use(stop_mm, warn_mm, THE_PAGE)
    except MarginGuardError as error:
        # The session lists its own refusals; what never reached it is listed here.
        last = commands.requests.last
        if last is None or last.accepted or last.text not in str(error):
            commands.requests.refused(RequestKind.MARGINS, THE_PAGE, str(error))


def _set_tumor(
    commands: OperatorCommands, edge: Transform, tumor: SurfaceMesh, sigma_mm: float
) -> None:
    with suppress(MarginGuardError):
        commands.requests.admit(RequestKind.TUMOR)
        commands.set_tumor(edge, tumor, sigma_mm=sigma_mm, origin=THE_PAGE)


def _record(commands: OperatorCommands, start: bool, name: str) -> None:
    # A refusal is in the list of requests.
    with suppress(MarginGuardError):
        if start:
            commands.start_recording(name, origin=THE_PAGE)
        else:
            commands.stop_recording(origin=THE_PAGE)


def _set_tip(commands: OperatorCommands, change: TipChange) -> None:
    with suppress(MarginGuardError):
        commands.requests.admit(tip_request_kind(change))
        use_tip(commands, change, THE_PAGE)


def _change_shown(commands: OperatorCommands, request: tuple[RequestKind, ShownChange]) -> None:
    # A refusal is in the list of requests.
    with suppress(MarginGuardError):
        commands.requests.admit(request[0])
        commands.change_shown(request, origin=THE_PAGE)


def _set_registration(commands: OperatorCommands, result: RegistrationResult) -> None:
    with suppress(MarginGuardError):
        commands.requests.admit(RequestKind.REGISTRATION)
        commands.set_registration(result, origin=THE_PAGE)


def _rearm(commands: OperatorCommands, seen: SeenHold) -> None:
    # A refusal is in the list of requests.
    with suppress(MarginGuardError):
        commands.rearm(seen, origin=THE_PAGE)
