"""Samples of frames that no decision uses, such as a stylus: they come with the other samples."""

from collections.abc import Collection, Iterable

from app.geometry import Edge, Stamp, TrackedTransform, shortest_path


class AuxiliarySamples:
    """Newest sample of each edge that leads to one of ``frames``, and to no frame of a decision.

    They neither begin nor delay a frame of the session, and do not train its clock. A stamp that is
    older than the one before is dropped, unless that one is after the present.
    """

    def __init__(self, frames: Collection[str]) -> None:
        self._frames = frozenset(frames)
        self._edges: frozenset[Edge] = frozenset()
        self._newest_ns: dict[Edge, int] = {}
        self._waiting: dict[Edge, TrackedTransform] = {}

    def find(self, edges: Iterable[Edge], used: frozenset[Edge], root: str) -> None:
        """Choose those of ``edges`` that connect ``root`` with the frames, and are not ``used``."""
        known = tuple(edges)
        paths = [shortest_path(known, root, frame) or () for frame in sorted(self._frames)]
        self._edges = frozenset(edge for path in paths for edge in path) - used

    def add(self, sample: TrackedTransform, now: Stamp | None) -> None:
        """Keep ``sample`` for the next frame if its edge is one of those chosen."""
        edge = (sample.target, sample.source)
        if edge not in self._edges:
            return
        newest_ns = self._newest_ns.get(edge)
        is_ahead = newest_ns is not None and now is not None and newest_ns > now.ns
        if newest_ns is None or is_ahead or sample.stamp.ns > newest_ns:
            self._newest_ns[edge] = sample.stamp.ns
            self._waiting[edge] = sample

    def take(self) -> tuple[TrackedTransform, ...]:
        """Remove the samples that came since the last call."""
        samples = tuple(self._waiting.values())
        self._waiting.clear()
        return samples

    def restart(self) -> None:
        """Forget the samples: the source's clock was set back."""
        self._newest_ns.clear()
        self._waiting.clear()
