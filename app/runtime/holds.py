"""What identifies a hold, so that an operator ends the one that was displayed and no other."""

import secrets
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

from app.fixture import MarginState, Reason
from app.geometry import MarginGuardError
from app.runtime.outputs import PassiveOutput, StepTiming
from app.session import StepResult


class RearmRefusedError(MarginGuardError):
    """The hold that the operator has seen is not the present one."""


@dataclass(frozen=True, slots=True)
class SeenHold:
    """The hold that an operator has seen: ``seq`` of a message or step, and its ``nonce``.

    The nonce is 0 if no hold had to be re-armed. Each fault and each loosening has another one.
    """

    seq: int
    nonce: int


class Holds(Protocol):
    """Identifies the present hold of a session. Thread-safe."""

    def present(self) -> SeenHold:
        """The hold of the message or step that was published last."""

    def check(self, seen: SeenHold) -> None:
        """Raise `RearmRefusedError` unless ``seen`` is the present hold. Does not wait."""

    def spend(self, seen: SeenHold) -> None:
        """End the validity of the nonce of ``seen``, which has ended its hold."""


class StepHolds(PassiveOutput):
    """Identifies the holds of a session by its steps, without a constraint that is published.

    `Output` and `Holds`: put it first among the outputs. ``random_bits`` creates nonces.
    """

    def __init__(self, random_bits: Callable[[int], int] = secrets.randbits) -> None:
        self._random_bits = random_bits
        self._present = SeenHold(0, 0)
        self._causes: tuple[str, ...] = ()
        self._unknown = False

    def publish(self, step: StepResult, timing: StepTiming) -> bool:
        """Follow the hold of ``step``."""
        decision, nonce = step.decision, self._present.nonce
        unknown = decision.state is MarginState.UNKNOWN
        if Reason.LATCHED not in decision.reasons:
            nonce = 0
        elif nonce == 0 or step.hold_causes != self._causes or unknown != self._unknown:
            nonce = self._draw()
        self._present = SeenHold(decision.seq, nonce)
        self._causes, self._unknown = step.hold_causes, unknown
        return True

    def latch(self, causes: Sequence[str]) -> None:
        """Begin another hold, which no step has shown yet."""
        self._present = SeenHold(self._present.seq, self._draw())
        self._causes = tuple(causes)

    def present(self) -> SeenHold:
        """The hold of the last step."""
        return self._present

    def check(self, seen: SeenHold) -> None:
        """Raise `RearmRefusedError` unless ``seen`` is the present hold."""
        check_nonce(seen.nonce, self._present.nonce)

    def spend(self, seen: SeenHold) -> None:
        """End the validity of the nonce."""
        if self._present.nonce == seen.nonce:
            self._present = SeenHold(self._present.seq, 0)

    def _draw(self) -> int:
        while not (drawn := self._random_bits(64)):
            pass
        return drawn


def check_nonce(nonce: int, present: int) -> None:
    """Raise `RearmRefusedError` unless ``nonce`` is that of the ``present`` hold, which is not 0.

    The message does not contain the valid one.
    """
    if present == 0:
        raise RearmRefusedError(
            "no hold is latched; expected a constraint with the reason 'latched'"
        )
    if nonce != present:
        raise RearmRefusedError(
            f"nonce is {nonce}: not that of the present hold; expected the rearm_nonce of its "
            "constraint"
        )
