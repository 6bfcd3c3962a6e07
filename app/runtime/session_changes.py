"""Changes of a running session, each between two steps, completely or not at all."""

import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager

from app.geometry import InputError
from app.hold import Holds
from app.runtime.case_recorder import CaseRecorder
from app.runtime.compute import Compute, compute_here
from app.runtime.content import SessionContent
from app.runtime.outputs import Output, SwitchContent
from app.runtime.requests import RequestLog
from app.session import Session, SessionSetup

BetweenSteps = Callable[[], AbstractContextManager[Session]]
"""Gives exclusive access to the session between two steps, as `LiveSession.between_steps` does."""

ContentChange = Callable[[SessionContent], SessionContent]
SetupChange = Callable[[SessionSetup], SessionSetup]

_SHORT_WAIT_S = 0.05


class SessionChanges:
    """Changes session, content and outputs together, and lists what is requested in ``requests``.

    ``between_steps`` gives access to the session. ``holds`` identifies the present hold.
    ``max_triangles`` limits a new structure, which ``compute`` prepares. ``recorder`` records the
    session; None for one that cannot be.
    """

    def __init__(
        self,
        between_steps: BetweenSteps,
        content: SessionContent,
        outputs: Sequence[Output],
        *,
        holds: Holds,
        max_triangles: int | None = None,
        requests: RequestLog | None = None,
        compute: Compute = compute_here,
        recorder: CaseRecorder | None = None,
    ) -> None:
        self._between_steps = between_steps
        self._compute = compute
        self._recorder = recorder
        self._content = self._initial = content
        self._outputs = outputs
        self._changing = threading.Lock()
        """One change at a time: its outputs prepare before the session is locked. A re-arm does not
        wait for it."""
        self._holds = holds
        self._max_triangles = max_triangles
        self._acknowledged = content
        self.requests = requests or RequestLog(time.time_ns, time.monotonic_ns)

    @property
    def compute(self) -> Compute:
        """Calls a function that computes for long, where it does not delay the session."""
        return self._compute

    @property
    def content(self) -> SessionContent:
        """The content in use."""
        return self._content

    @property
    def setup(self) -> SessionSetup:
        """The setup that the session steps with now; waits for a step that is being taken."""
        with self._between_steps() as session:
            return session.setup

    @property
    def requested(self) -> SessionSetup:
        """The setup in use, but with the margins that apply from the next re-arm on."""
        with self._between_steps() as session:
            return session.requested

    @contextmanager
    def _change_at_once(self, what: str, wait_s: float = _SHORT_WAIT_S) -> Iterator[None]:
        """Holds the lock of the changes; raises `InputError` if it is not free soon."""
        if not self._changing.acquire(timeout=wait_s):
            raise InputError(
                f"{what}: another change is being prepared; expected the same request again"
            )
        try:
            yield
        finally:
            self._changing.release()

    @contextmanager
    def _listed(self, kind: str, origin: str) -> Iterator[list[str]]:
        """List the request as accepted, with the texts added to the list, or as refused."""
        done: list[str] = []
        before = self._content
        try:
            yield done
        except Exception as error:
            self.requests.refused(kind, origin, str(error))
            raise
        if self._recorder is not None and self._content is not before:
            self._recorder.note_replaced(self._content.unpublished_changes(before))
            if self._content.image_depth != before.image_depth:
                self._recorder.note_depth()
        self.requests.accepted(kind, origin, "; ".join(done))

    def _change(self, change: ContentChange, used: SetupChange = lambda setup: setup) -> None:
        """Use the content after ``change`` and the setup after ``used`` from the next step on."""
        switches = self._prepare(change(self._content))
        with self._between_steps() as session:
            content = change(self._content)
            self._apply(session, used(content.setup(session.requested)), content, switches)

    def _prepare(self, content: SessionContent) -> list[SwitchContent]:
        return [output.prepare(content) for output in self._outputs]

    def _apply(
        self,
        session: Session,
        setup: SessionSetup,
        content: SessionContent,
        switches: list[SwitchContent],
        tumor_change: str = "",
    ) -> bool:
        """Change session and outputs; True if that latched a hold."""
        loosened = session.use(setup, tumor_change=tumor_change)
        self._switch(content.with_margins(session.setup), switches)
        if loosened:
            for output in self._outputs:
                output.latch(session.hold_causes)
        return loosened

    def _switch(self, content: SessionContent, switches: list[SwitchContent]) -> None:
        # The permissions of the last step were computed with the previous content.
        for output in self._outputs:
            output.revoke()
        for switch in switches:
            switch(content)
        self._content = content
