"""Current image of a page, recorded or live: the newest one at a time, its pixels and its pose."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

from app.case.frame_streams import agreed_sample
from app.geometry import (
    NS_PER_MS,
    Edge,
    FloatArray,
    ImageSample,
    StampHistory,
    TrackedTransform,
    Transform,
    product_along,
    shortest_path,
)


@dataclass(frozen=True, slots=True, eq=False)
class ImagePose:
    """Where an image is: ``matrix`` (4, 4) maps (column, row, 0) to mm in a frame.

    ``matrix`` is None exactly if ``problem`` is not empty: an image whose place is not known has no
    place at which it could be drawn by mistake.
    """

    matrix: FloatArray | None
    problem: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class CurrentImage:
    """The newest image at a time. It may be shown exactly if ``pose`` has a matrix.

    ``number``: None before the first image. ``depth_mm``: the imaging depth by whose calibration it
    is placed; None for a probe with one.
    """

    number: int | None
    pose: ImagePose
    depth_mm: float | None = None


class ImageSource(Protocol):
    """Images that a page shows. One thread calls it."""

    @property
    def size(self) -> tuple[int, int] | None:
        """Columns and rows of every image, in MF; None before the first one."""

    def at(self, now_ns: int, frame: str) -> CurrentImage:
        """The newest image at ``now_ns`` on the tracker's clock, placed in ``frame``."""

    def image(self, number: int) -> ImageSample:
        """Image ``number``, one that `at` has just named."""


MAX_EDGES = 256
_MIN_SAMPLES, _MAX_SAMPLES = 256, 8192
"""Minimum and maximum of samples kept of an edge with ``keep_ns``; the latter bounds the memory."""


class PoseHistory:
    """``history.matrix(stamp_ns, target, source)``: a pose at any time, between two samples, too.

    Between two valid samples that are at most ``max_gap_ns`` apart a pose is interpolated, linear
    in translation and by the shortest arc in rotation. It is never extrapolated. With ``keep_ns``
    samples older than that before the newest one of their edge are dropped, except the last 256; a
    sample that is older than that when it arrives means that the clock was set back, and starts its
    edge anew. Edges beyond `MAX_EDGES` are ignored. Not thread-safe.
    """

    def __init__(self, max_gap_ns: int, keep_ns: float = math.inf) -> None:
        self._max_gap_ns, self._keep_ns = max_gap_ns, keep_ns
        self._trails: dict[Edge, StampHistory[TrackedTransform]] = {}
        self._paths: dict[Edge, tuple[Edge, ...] | None] = {}

    def add(self, samples: Sequence[TrackedTransform]) -> None:
        """Add samples of any edges, in any order."""
        for sample in samples:
            edge = sample.target, sample.source
            trail = self._trails.get(edge)
            if trail is None:
                if len(self._trails) >= MAX_EDGES:
                    continue
                trail = self._trails[edge] = StampHistory(
                    keep_ns=self._keep_ns,
                    restart_ns=self._keep_ns,
                    max_values=_MAX_SAMPLES if math.isfinite(self._keep_ns) else math.inf,
                    min_values=_MIN_SAMPLES,
                    merge=agreed_sample,
                )
                self._paths.clear()
            trail.insert(sample.stamp.ns, sample)

    def reaches(self, stamp_ns: int, target: str, source: str) -> bool:
        """True if a later sample can not change the pose at ``stamp_ns``.

        That is so once each edge between the frames has a sample at this time or after it.
        """
        path = self._path(target, source)
        return path is not None and all(self._trails[edge].newest_ns >= stamp_ns for edge in path)

    def matrix(self, stamp_ns: int, target: str, source: str) -> FloatArray | str:
        """Return ``target_from_source`` (4, 4) at ``stamp_ns``, or the reason why it is not known.

        The path with the fewest edges is used.
        """
        path = self._path(target, source)
        if path is None:
            return f"no pose connects {target!r} with {source!r}"
        poses = []
        for edge in path:
            pose = self._at(edge, stamp_ns)
            if isinstance(pose, str):
                return pose
            poses.append(pose)
        return product_along(target, poses).matrix

    def _at(self, edge: Edge, stamp_ns: int) -> Transform | str:
        trail, name = self._trails[edge], f"{edge[0]} -> {edge[1]}"
        found = trail.around(stamp_ns)
        if found is None:
            late_ms = (stamp_ns - trail.newest_ns) / NS_PER_MS
            if late_ms < 0.0:
                return f"no pose of {name} before the image"
            return f"the newest pose of {name} is {late_ms:.0f} ms before the image"
        before, after, fraction = found
        if before.transform is None or after.transform is None:
            lost = before if before.transform is None else after
            return f"{name} is {lost.status.name}"
        gap_ns = after.stamp.ns - before.stamp.ns
        if gap_ns > self._max_gap_ns:
            return (
                f"the poses of {name} around the image are {gap_ns / NS_PER_MS:.0f} ms apart; "
                f"expected at most {self._max_gap_ns / NS_PER_MS:.0f} ms"
            )
        return before.transform.interpolate(after.transform, fraction)

    def _path(self, target: str, source: str) -> tuple[Edge, ...] | None:
        ends = target, source
        if ends not in self._paths:
            self._paths[ends] = shortest_path(self._trails, target, source)
        return self._paths[ends]
