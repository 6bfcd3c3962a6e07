"""Keeps the hold of a live session in its `LiveState`, from its first step to its end."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict
from typing import Any

from app.fixture import Reason
from app.geometry import Transform
from app.hold import LiveState
from app.runtime.content import SessionContent
from app.session import LiveSession, StepResult


class HoldKeeper:
    """Begins a session on hold where ``state`` demands it, and notes the values that it uses.

    At the end it notes how the session has ended.

    ``has_expired()`` is True while a constraint has become stale that no step has replaced yet: the
    hold that it began is not latched in the session.
    """

    def __init__(self, state: LiveState, has_expired: Callable[[], bool]) -> None:
        self._state = state
        self._has_expired = has_expired
        self._begun = False
        self._content: SessionContent | None = None

    @contextmanager
    def kept(self, live: LiveSession) -> Iterator[None]:
        """Within the context the steps of ``live`` are taken."""
        if not self._begun:
            self._begun = True
            for cause in self._state.start_causes:
                # The last run may have doubted the pose, which is plausible from its first sample.
                live.hold(cause, doubt=True)
        self._state.resume()
        try:
            yield
        except BaseException as error:  # also of the reader of the steps
            reason = str(error) or type(error).__name__  # a reader that leaves: GeneratorExit
            self._state.update(True, (*self._causes(live), f"the session has failed: {reason}"))
            raise
        with live.between_steps() as session:
            latched = session.latched or self._has_expired()
            self._state.end(latched, session.hold_causes)

    def note(self, step: StepResult, content: SessionContent) -> None:
        """Note the hold of ``step``, and ``content`` if it is another one. Returns at once."""
        if content is not self._content:
            self._content = content
            self._state.use(used_values(content))
        self._state.update(Reason.LATCHED in step.decision.reasons, step.hold_causes)

    def _causes(self, live: LiveSession) -> tuple[str, ...]:
        with live.between_steps() as session:
            return session.hold_causes


def used_values(content: SessionContent) -> dict[str, Any]:
    """The values of ``content``: equal ones permit the same."""
    registration, depth = content.registration, content.image_depth
    return {
        "tumor": {
            "surface": content.model_id,
            "pose": _pose(content.frame_from_tumor),
            "sigma_mm": float(content.tumor_sigma_mm),
        },
        "tip": {"pose": _pose(content.tool_from_tip), "sigma_mm": float(content.tip_sigma_mm)},
        "registration": None if registration is None else _pose(registration.transform),
        "margins": asdict(content.margins),
        "image_depth_mm": None if depth is None else float(depth.depth_mm),
    }


def _pose(transform: Transform) -> list[Any]:
    return [transform.target, transform.source, transform.matrix.ravel().tolist()]
