"""Poses of tracked frames over time: where the probe was when an image was acquired."""

from bisect import bisect_left
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np

from app.case.frames.assembly import agreed_sample
from app.geometry import NS_PER_MS, FloatArray, TrackedTransform

MAX_EDGES = 256
_PRUNE_ABOVE = 256
"""Samples of an edge above which the oldest ones are dropped."""

_MAX_SAMPLES = 8192
"""Of an edge, with ``keep_ns``: bounds the memory that a sender can take."""

Step = tuple[tuple[str, str], bool]
"""An edge (target, source), and whether it is followed from its source to its target."""


@dataclass(slots=True)
class _Trail:
    """Samples of one edge in the order of their stamps."""

    stamps_ns: list[int] = field(default_factory=list)
    samples: list[TrackedTransform] = field(default_factory=list)


class PoseHistory:
    """``history.matrix(stamp_ns, target, source)``: a pose at any time, between two samples, too.

    Between two valid samples that are at most ``max_gap_ns`` apart a pose is interpolated, linear
    in translation and by the shortest arc in rotation. It is never extrapolated. With ``keep_ns``
    samples older than that before the newest one of their edge are dropped; a sample that is older
    than that when it arrives means that the clock was set back, and starts its edge anew. Edges
    beyond `MAX_EDGES` are ignored. Not thread-safe.
    """

    def __init__(self, max_gap_ns: int, keep_ns: int | None = None) -> None:
        self._max_gap_ns, self._keep_ns = max_gap_ns, keep_ns
        self._trails: dict[tuple[str, str], _Trail] = {}
        self._paths: dict[tuple[str, str], tuple[Step, ...] | None] = {}

    def add(self, samples: Sequence[TrackedTransform]) -> None:
        """Add samples of any edges, in any order."""
        for sample in samples:
            edge = sample.target, sample.source
            trail = self._trails.get(edge)
            if trail is None:
                if len(self._trails) >= MAX_EDGES:
                    continue
                trail = self._trails[edge] = _Trail()
                self._paths.clear()
            self._insert(trail, sample)

    def reaches(self, stamp_ns: int, target: str, source: str) -> bool:
        """True if a later sample can not change the pose at ``stamp_ns``.

        That is so once each edge between the frames has a sample at this time or after it.
        """
        path = self._path(target, source)
        return path is not None and all(
            self._trails[edge].stamps_ns[-1] >= stamp_ns for edge, _ in path
        )

    def matrix(self, stamp_ns: int, target: str, source: str) -> FloatArray | str:
        """Return ``target_from_source`` (4, 4) at ``stamp_ns``, or the reason why it is not known.

        The path with the fewest edges is used.
        """
        path = self._path(target, source)
        if path is None:
            return f"no pose connects {target!r} with {source!r}"
        found: FloatArray = np.eye(4)
        for edge, is_inverse in path:
            pose = self._at(edge, stamp_ns)
            if isinstance(pose, str):
                return pose
            found = found @ (np.linalg.inv(pose) if is_inverse else pose)
        return found

    def _insert(self, trail: _Trail, sample: TrackedTransform) -> None:
        stamps, samples, ns = trail.stamps_ns, trail.samples, sample.stamp.ns
        if stamps and self._keep_ns is not None and ns < stamps[-1] - self._keep_ns:
            stamps.clear()
            samples.clear()
        place = bisect_left(stamps, ns)
        if place < len(stamps) and stamps[place] == ns:
            samples[place] = agreed_sample(samples[place], sample)
            return
        stamps.insert(place, ns)
        samples.insert(place, sample)
        if self._keep_ns is not None and len(stamps) > _PRUNE_ABOVE:
            old = max(bisect_left(stamps, stamps[-1] - self._keep_ns), len(stamps) - _MAX_SAMPLES)
            del stamps[:old], samples[:old]

    def _at(self, edge: tuple[str, str], stamp_ns: int) -> FloatArray | str:
        trail, name = self._trails[edge], f"{edge[0]} -> {edge[1]}"
        place = bisect_left(trail.stamps_ns, stamp_ns)
        if place == len(trail.stamps_ns):
            late_ms = (stamp_ns - trail.stamps_ns[-1]) / NS_PER_MS
            return f"the newest pose of {name} is {late_ms:.0f} ms before the image"
        after = trail.samples[place]
        if trail.stamps_ns[place] == stamp_ns:
            before = after
        elif place == 0:
            return f"no pose of {name} before the image"
        else:
            before = trail.samples[place - 1]
        if before.transform is None or after.transform is None:
            lost = before if before.transform is None else after
            return f"{name} is {lost.status.name}"
        gap_ns = after.stamp.ns - before.stamp.ns
        if gap_ns > self._max_gap_ns:
            return (
                f"the poses of {name} around the image are {gap_ns / NS_PER_MS:.0f} ms apart; "
                f"expected at most {self._max_gap_ns / NS_PER_MS:.0f} ms"
            )
        fraction = (stamp_ns - before.stamp.ns) / gap_ns if gap_ns else 0.0
        return before.transform.interpolate(after.transform, fraction).matrix

    def _path(self, target: str, source: str) -> tuple[Step, ...] | None:
        ends = target, source
        if ends not in self._paths:
            self._paths[ends] = _shortest(self._trails, target, source)
        return self._paths[ends]


def _shortest(
    edges: Iterable[tuple[str, str]], target: str, source: str
) -> tuple[Step, ...] | None:
    """Edges from ``target`` to ``source``; None if nothing connects them."""
    steps: dict[str, list[tuple[str, Step]]] = {}
    for parent, child in edges:
        steps.setdefault(parent, []).append((child, ((parent, child), False)))
        steps.setdefault(child, []).append((parent, ((parent, child), True)))
    reached: dict[str, tuple[Step, ...]] = {target: ()}
    to_visit = [target]
    for frame in to_visit:  # grows in the loop: a search in breadth
        for neighbour, step in steps.get(frame, ()):
            if neighbour not in reached:
                reached[neighbour] = (*reached[frame], step)
                to_visit.append(neighbour)
    return reached.get(source)
