"""A step at which one of several structures is far."""

from itertools import islice

from app.runtime import PreparedCase
from app.session import Session, StepResult


def far_step(case: PreparedCase) -> StepResult:
    """The second step of the case with three structures: the second lesion is far."""
    session = Session(case.setup, skip_far=True)
    return [session.step(frame) for frame in islice(case.case.frames(), 2)][-1]
