"""Texts on what began and prolonged the present hold, for the operator who re-arms it."""

from collections.abc import Mapping

from app.fixture import FixtureDecision, Reason
from app.session.loosening import loosenings
from app.session.setup import SessionSetup

MAX_CAUSES = 8
"""Most causes of a hold that are listed."""

_UNDONE = "a change that loosened the session was undone"


class HoldCauses:
    """Changes since the operator last agreed, then faults, each oldest first.

    Changes are those from the setup of the last re-arm (or of the start) to the present one, so
    that their number is bounded and no later change hides an earlier one. Of the faults the first
    ones and the newest are kept.
    """

    def __init__(self, setup: SessionSetup) -> None:
        self._agreed = setup
        self._tumor_change = ""
        self._changes: tuple[str, ...] = ()
        self._faults: tuple[str, ...] = ()

    @property
    def texts(self) -> tuple[str, ...]:
        """At most `MAX_CAUSES` texts, each different; empty without a hold."""
        return (*self._changes, *self._faults)

    def add(self, cause: str) -> None:
        """Add a fault."""
        if cause not in self._faults:
            kept = max(MAX_CAUSES - len(self._changes), 1)
            self._faults = (*self._faults[: kept - 1], cause)

    def follow(self, decision: FixtureDecision, outside: Mapping[Reason, str]) -> None:
        """Add the faults of ``decision``, with the texts of ``outside``; clear all without a hold.

        A hold that ends by itself had no change, because a change is latched.
        """
        if not decision.hold:
            self._faults = ()
            return
        for reason in decision.reasons:
            if reason.is_fault and reason is not Reason.RECOVERING:
                self.add(outside.get(reason) or reason.text)

    def change(self, before: SessionSetup, after: SessionSetup, tumor_change: str) -> bool:
        """Note the change from ``before`` to ``after``; True if it loosens and has to be latched.

        ``tumor_change`` describes the new tumour against the one of the last re-arm.
        """
        self._tumor_change = tumor_change or self._tumor_change
        loosens = bool(loosenings(before, after))
        if not loosens and not self._changes:
            self._agreed = after  # tightening needs no consent
            return False
        texts = loosenings(self._agreed, after, self._tumor_change)
        self._changes = tuple(texts or [_UNDONE])
        kept = max(MAX_CAUSES - len(self._changes), 1)
        if len(self._faults) > kept:  # the first ones, and the newest
            self._faults = (*self._faults[: kept - 1], self._faults[-1])
        return loosens

    def agree(self, setup: SessionSetup) -> None:
        """Clear all: the operator has seen them, and ``setup``, and has re-armed."""
        self._agreed = setup
        self._tumor_change = ""
        self._changes = self._faults = ()
