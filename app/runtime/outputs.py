"""Receivers of the steps of a run: ROS publishers, the scene, a report, a recorder."""

import secrets
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Protocol

from app.fixture import MarginState, Reason
from app.hold import HoldIdentity, RandomBits, SeenHold
from app.runtime.content import SessionContent
from app.session import StepResult

SwitchContent = Callable[[SessionContent], None]
"""Makes an output use a content from the next step on. Quick, and must not raise.

Called between two steps.
"""


@dataclass(frozen=True, slots=True)
class StepTiming:
    """Timing of a step.

    ``duration_ns``: time that the session took to compute it. ``spent_ns``: time since its frame
    was the present, 0 in a replay; it goes on, and ``clock`` returns it at present. ``in_time`` is
    False when an earlier output found the step too late: it must not permit any motion then.
    """

    duration_ns: int = 0
    spent_ns: int = 0
    in_time: bool = True
    clock: Callable[[], int] | None = None

    def spent_now_ns(self) -> int:
        """Time in ns since the step's frame was the present.

        A validity that begins now must subtract it, and read its own clock *before*: a stop of the
        process between the two then shortens the validity.
        """
        return self.spent_ns if self.clock is None else self.clock()


class Output(Protocol):
    """Receives every step of a run, in the thread that steps."""

    def publish(self, step: StepResult, timing: StepTiming) -> bool:
        """Process ``step``; False when it came too late, so that a live session has to hold."""

    def prepare(self, content: SessionContent) -> SwitchContent:
        """Do the slow part of switching to ``content``, from any thread; return the quick part.

        Raises `MarginGuardError` for a content that this output cannot use; nothing has changed
        then. The returned function may be called with a content that has other margins and static
        edges, but the same tumour and tool.
        """

    def revoke(self) -> None:
        """Withdraw every permission of the last step at once; from any thread."""

    def latch(self, causes: Sequence[str]) -> None:
        """A hold was latched between two steps, by a change that loosens: show it at once.

        Called after the switch to the changed content, with all causes of the hold.
        """

    def end(self) -> None:
        """Publish the final state, because no step follows. A run calls it once, at its end."""


class PassiveOutput:
    """Base class of outputs that permit no motion and store nothing of a content."""

    def prepare(self, content: SessionContent) -> SwitchContent:
        """Return the switch; nothing needs to be prepared."""
        return self._use

    def revoke(self) -> None:
        """Nothing to withdraw."""

    def latch(self, causes: Sequence[str]) -> None:
        """Nothing to show: the next step does."""

    def end(self) -> None:
        """Nothing to publish."""

    def _use(self, content: SessionContent) -> None:
        """Switch to ``content``."""


class StepHolds(PassiveOutput):
    """Identifies the holds of a session by its steps, without a constraint that is published.

    `Output` and `app.hold.Holds`: put it first among the outputs. ``random_bits`` creates nonces.
    """

    def __init__(self, random_bits: RandomBits = secrets.randbits) -> None:
        self._identity = HoldIdentity(time.time_ns, random_bits)
        self._seq = 0

    def publish(self, step: StepResult, timing: StepTiming) -> bool:
        """Follow the hold of ``step``."""
        decision = step.decision
        faulty = decision.state is MarginState.UNKNOWN
        if self._identity.is_new(step.hold_causes, faulty=faulty):
            self._identity.renew()
        self._identity.note(step.hold_causes, faulty=faulty)
        self._identity.follow(hold=decision.hold, latched=Reason.LATCHED in decision.reasons)
        self._seq = decision.seq
        return True

    def latch(self, causes: Sequence[str]) -> None:
        """Begin another hold, which no step has shown yet."""
        self._identity.renew()
        self._identity.note(causes, faulty=False)

    def present(self) -> SeenHold:
        """The hold of the last step."""
        return SeenHold(self._seq, self._identity.nonce)

    def check(self, seen: SeenHold) -> None:
        """Raise `RearmRefusedError` unless ``seen`` is the present hold."""
        self._identity.check(seen.nonce)

    def consume(self, seen: SeenHold) -> None:
        """End the validity of the nonce."""
        self._identity.consume(seen.nonce)


def end_outputs(outputs: Sequence[Output]) -> None:
    """Let all ``outputs`` withdraw what they permitted, then end; the last one first.

    The error of one does not keep the others from ending; it is raised afterwards.
    """
    with ExitStack() as at_end:
        for output in outputs:
            at_end.callback(output.end)
        for output in outputs:
            at_end.callback(output.revoke)
