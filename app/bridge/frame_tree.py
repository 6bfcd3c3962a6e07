"""Which frames a step moves: the edges of ``/tf``, each with the stamp of its own sample."""

from collections.abc import Iterator
from dataclasses import dataclass, field

from app.fixture import MarginState
from app.geometry import Stamp, Transform
from app.session import StepResult


def moving_edges(step: StepResult) -> Iterator[tuple[Transform, Stamp]]:
    """Every transform that ``step`` knows, with the time at which it was true.

    Measured edges are as they were measured, lost ones left out: tf has no word for "lost", its
    absence and ``/diagnostics`` say it. The robot's links hang from its root like a star, so no
    joint is needed to place them. The fixture has the stamp of the oldest sample that went in;
    while the margin is UNKNOWN the last plane still holds, but nothing newer is known to send.
    """
    for sample in step.frame.poses:
        if sample.transform is not None:
            yield sample.transform, sample.stamp
    if step.joints is not None:
        for link, root_from_link in step.links.items():
            if link != root_from_link.target:
                yield root_from_link, step.joints.stamp
    decision = step.decision
    if (
        decision.state is not MarginState.UNKNOWN
        and decision.stamp is not None
        and step.virtual_fixture is not None
    ):
        yield step.virtual_fixture, decision.stamp


@dataclass(slots=True)
class FrameTree:
    """Hands out each sample once.

    tf2 complains about a transform that comes again with the stamp that it had, as a joint sample
    does when the tracker is faster than the robot. When the player seeks back, all is new again.
    """

    _newest_ns: dict[str, int] = field(default_factory=dict)
    _now_ns: int | None = None

    def news(self, step: StepResult) -> list[tuple[Transform, Stamp]]:
        """The moving edges of ``step`` that are newer than the last of the same child frame."""
        if self._now_ns is not None and step.frame.stamp.ns < self._now_ns:
            self._newest_ns.clear()
        self._now_ns = step.frame.stamp.ns
        found = []
        for transform, stamp in moving_edges(step):
            newest_ns = self._newest_ns.get(transform.source)
            if newest_ns is None or stamp.ns > newest_ns:
                self._newest_ns[transform.source] = stamp.ns
                found.append((transform, stamp))
        return found
