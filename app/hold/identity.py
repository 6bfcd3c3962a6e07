"""Identity of a hold, by which an operator ends the one that was displayed and no other."""

import secrets
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import NamedTuple, Protocol

from app.geometry import MarginGuardError

RandomBits = Callable[[int], int]
"""Returns a random integer of that many bits, as `secrets.randbits` does."""


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

    def consume(self, seen: SeenHold) -> None:
        """End the validity of the nonce of ``seen``, which has ended its hold."""


class NextHold(NamedTuple):
    """Identity of a hold that a later fault begins."""

    nonce: int
    since_ns: int


class HoldIdentity:
    """The nonce of the present hold, and the time at which it began.

    The nonce is 0 unless the hold is latched, otherwise a random number that is replaced with each
    fault and each further cause, and ends with `consume`. ``clock_ns`` is the system time, and
    ``random_bits`` creates the nonces.
    """

    def __init__(
        self, clock_ns: Callable[[], int], random_bits: RandomBits = secrets.randbits
    ) -> None:
        self._clock_ns = clock_ns
        self._random_bits = random_bits
        self._next_nonce = self._draw()
        self._faulty = False
        self._causes: frozenset[str] = frozenset()
        self.nonce = 0
        self.since_ns: int | None = None
        """System time at which the hold began; None without one."""

    def is_new(self, causes: Iterable[str], *, faulty: bool = False) -> bool:
        """True for a fault after none, and for a hold with a cause that was not noted before."""
        return (faulty and not self._faulty) or not self._causes.issuperset(causes)

    def note(self, causes: Iterable[str], *, faulty: bool) -> None:
        """Note the causes of the hold that was published, and whether it was by a fault."""
        self._causes, self._faulty = frozenset(causes), faulty

    def forget_causes(self) -> None:
        """No hold is published any more: each cause of a later one is new."""
        self._causes = frozenset()

    def renew(self) -> None:
        """Replace the nonce: a re-arm of what was published before is not valid any more."""
        self.nonce, self._next_nonce = self._next_nonce, self._draw()

    def follow(self, *, hold: bool, latched: bool) -> None:
        """Begin or end the hold as the decision that is published next says."""
        self.since_ns = self._since_ns(0) if hold else None
        if not latched:
            self.nonce = 0
        elif self.nonce == 0:
            self.renew()

    def next(self, delay_ns: int = 0) -> NextHold:
        """Identity of the hold that a fault after ``delay_ns`` begins, if none has begun before."""
        return NextHold(self._next_nonce, self._since_ns(delay_ns))

    def continue_with(self, published: NextHold) -> None:
        """Make ``published``, which receivers have already, the present hold."""
        self.nonce, self.since_ns = published
        if self._next_nonce == self.nonce:
            self._next_nonce = self._draw()

    def check(self, nonce: int) -> None:
        """Raise `RearmRefusedError` unless ``nonce`` is that of the hold, and it is latched.

        The message does not contain the valid one.
        """
        if self.nonce == 0:
            raise RearmRefusedError(
                "no hold is latched; expected a constraint with the reason 'latched'"
            )
        if nonce != self.nonce:
            raise RearmRefusedError(
                f"nonce is {nonce}: not that of the present hold; expected the rearm_nonce of its "
                "constraint"
            )

    def consume(self, nonce: int) -> None:
        """End the validity of ``nonce`` after it has re-armed its hold."""
        if self.nonce == nonce:
            self.nonce = 0

    def _since_ns(self, delay_ns: int) -> int:
        return self._clock_ns() + delay_ns if self.since_ns is None else self.since_ns

    def _draw(self) -> int:
        """A random number other than 0."""
        while not (drawn := self._random_bits(64)):
            pass
        return drawn
