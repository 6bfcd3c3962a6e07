"""The hold of a session as one state machine: what latches it, its causes, what ends it."""

import secrets
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

from app.fixture import POSE_DOUBTS, FixtureDecision, MarginState, Reason, worst_first
from app.geometry import MarginGuardError

MAX_CAUSES = 8
"""Most causes of a hold that are listed."""

RandomBits = Callable[[int], int]
"""Returns a random integer of that many bits, as `secrets.randbits` does."""


class NotRearmableError(MarginGuardError):
    """The hold cannot be ended, because the fault is still present."""


class Hold:
    """Puts the decisions of a `MarginMonitor` on hold, from a fault to the re-arm of an operator.

    A decision that is UNKNOWN is on hold by itself, and that ends by itself. The hold is *latched*,
    and lasts until `rearm`, by

    - a fault after the first complete valid evaluation; before it by one of `POSE_DOUBTS` only,
      because the poses that follow may be the wrong ones;
    - `change` with a change that loosens, and `restart` after a known margin;
    - `latch`, for what only the caller can detect.

    While the pose of the tool is *doubted*, no plane is current: a retreat from a wrong pose may be
    an approach. One of `POSE_DOUBTS`, `doubt` and `latch` with doubt begin that, and it lasts as
    long as the hold: the jump to a wrong place takes one sample, and what follows is plausible.

    The causes are changes since the last re-arm, then faults, each oldest first. Of the faults the
    first ones and the newest are kept.
    """

    def __init__(self) -> None:
        self._latched = self._doubted = False
        self._started = self._known = False
        self._changes: tuple[str, ...] = ()
        self._faults: tuple[str, ...] = ()

    @property
    def latched(self) -> bool:
        """True if the hold lasts until `rearm`."""
        return self._latched

    @property
    def causes(self) -> tuple[str, ...]:
        """At most `MAX_CAUSES` texts, each different; empty without a hold."""
        return (*self._changes, *self._faults)

    def applied(
        self,
        decision: FixtureDecision,
        outside: Mapping[Reason, str],
        parts: Sequence[FixtureDecision] = (),
    ) -> FixtureDecision:
        """``decision`` with this hold. Call it once for each decision, in their order.

        ``parts``: the decisions on the structures that it is about, if they are several. A
        structure that is added to a known session is UNKNOWN until it is measured, which latches
        no hold by itself.
        ``outside``: texts of faults that the caller found, which name them better than the reason.
        """
        self._known = decision.state is not MarginState.UNKNOWN
        self._started = self._started or Reason.STARTING not in decision.reasons
        if not decision.hold and not self._latched:
            # A hold that ends by itself had no change, because a change is latched.
            self._doubted, self._faults = False, ()
            return decision
        faults = [reason for reason in decision.reasons if reason.is_fault]
        doubts = not POSE_DOUBTS.isdisjoint(faults)
        self._latched = self._latched or doubts or self._lasts(parts or (decision,))
        self._doubted = self._doubted or doubts
        for reason in faults:
            # A change explains that all is measured anew.
            explained = reason is Reason.STARTING and self._changes
            if reason is not Reason.RECOVERING and not explained:
                self._add_fault(outside.get(reason) or reason.text)
        constraint, reasons = decision.constraint, decision.reasons
        if self._latched:
            reasons = worst_first((*reasons, Reason.LATCHED))
            constraint = None if constraint is None else constraint.with_hold()
        return decision._replace(
            reasons=reasons,
            constraint=constraint,
            hold=True,
            constraint_is_current=decision.constraint_is_current and not self._doubted,
        )

    def _lasts(self, decisions: Sequence[FixtureDecision]) -> bool:
        """True if a fault of known data is among ``decisions``; recovery from one is none."""
        begun = [each for each in decisions if Reason.STARTING not in each.reasons]
        found = {reason for each in begun for reason in each.reasons if reason.is_fault}
        return self._started and not found <= {Reason.RECOVERING}

    def latch_by_error(self) -> None:
        """Latch the hold after an error in a step: what that would have found is lost."""
        self._known = False
        self.latch("a step has failed", doubt=True)

    def latch(self, cause: str, *, doubt: bool = False) -> None:
        """Latch the hold for ``cause``, a text for the operator; with ``doubt`` of the pose."""
        self._latched = True
        self._doubted = self._doubted or doubt
        self._add_fault(cause)

    def change(self, changes: Sequence[str], *, latch: bool) -> None:
        """Replace the changes to be acknowledged by an operator; ``latch`` if the last one loosens.

        They are all changes since the last re-arm, so that their number is bounded and no later
        one hides an earlier one.
        """
        self._changes = tuple(changes)
        self._latched = self._latched or latch
        kept = self._kept_faults
        if len(self._faults) > kept:
            self._faults = (*self._faults[: kept - 1], self._faults[-1])

    def restart(self) -> None:
        """Begin anew with another tumour, tool or registration; latches if the margin was known.

        Until the next decision the state is UNKNOWN.
        """
        self._latched = self._latched or self._started
        self._started = self._known = False

    def doubt(self) -> None:
        """Doubt the pose, with a hold that is latched."""
        self._doubted = True

    def rearm(self) -> None:
        """End the hold, whose causes the operator has seen; `NotRearmableError` while UNKNOWN."""
        if not self._known:
            raise NotRearmableError(
                "the state is UNKNOWN; expected a known state: its cause must end before re-arming"
            )
        self._latched = False
        self._changes = self._faults = ()

    @property
    def _kept_faults(self) -> int:
        return max(MAX_CAUSES - len(self._changes), 1)

    def _add_fault(self, cause: str) -> None:
        if cause not in self._faults:
            self._faults = (*self._faults[: self._kept_faults - 1], cause)


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
