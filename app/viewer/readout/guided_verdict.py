"""The verdict on a guided recording as texts of the page."""

from typing import Protocol

from app.runtime import Phase


class Fit(Protocol):
    """What a fit says about the recording."""

    @property
    def accepted(self) -> bool:
        """True if the session may use it."""

    @property
    def reason(self) -> str:
        """Why it is accepted or not."""

    @property
    def advice(self) -> str:
        """What to do next; empty if it is accepted."""


def verdict_of(fit: Fit, phase: Phase, when_enough: str) -> tuple[str, str]:
    """If it is good enough, or why not yet; and what to do (``when_enough`` while it records)."""
    advice = f"{fit.advice[:1].upper()}{fit.advice[1:]}." if fit.advice else ""
    if fit.accepted:
        return f"Good enough: {fit.reason}", when_enough if phase is Phase.RECORDING else ""
    return f"{'Not yet' if phase is Phase.RECORDING else 'Not accepted'}: {fit.reason}", advice
