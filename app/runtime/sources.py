"""Where a live run gets its tracked transforms: ROS topics, OpenIGTLink, a recording."""

from collections.abc import Callable, Mapping, Sequence
from typing import Protocol

from app.geometry import TrackedTransform

Deliver = Callable[[Sequence[TrackedTransform]], None]
"""Takes samples that arrived together, from any thread, without waiting."""


class Source(Protocol):
    """A tracker: it delivers samples from its construction until `close`.

    Stamps are the source's own. A lost pose is delivered too, with its status. A sample that
    cannot be used is dropped and counted.
    """

    def counts(self) -> Mapping[str, int]:
        """Counts of received and dropped samples, for diagnostics."""

    def close(self) -> None:
        """Stop delivering. A second call does nothing."""
