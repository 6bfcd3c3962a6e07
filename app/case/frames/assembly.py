"""Assembles samples, in the order of arrival, into frames in the order of acquisition."""

from bisect import bisect_left, bisect_right, insort_right
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from app.case.frames.cautery import CauteryState
from app.case.frames.samples import JointSample, TrackingFrame
from app.geometry import NS_PER_MS, Stamp, TrackedTransform, TrackingStatus

REORDER_NS = 500 * NS_PER_MS
"""Largest delay of a sample that is still sorted into the order of acquisition."""

_MAX_PENDING_JOINTS = 20_000
_MAX_PENDING_FRAMES = 10_000
"""Stamps in the buffer: 20 kHz, which no tracker reaches."""


@dataclass(slots=True)
class _Draft:
    stamp: Stamp
    poses: dict[tuple[str, str], TrackedTransform]
    unfiltered: Stamp | None = None
    cautery: CauteryState | None = None


class FrameAssembler:
    """Groups samples by acquisition stamp, through a buffer that is `REORDER_NS` long.

    A sample older than that counts as a clock that jumped back: all buffered frames are returned
    and the order starts anew, so that the jump stays visible. Joints go with the first frame that
    is not older than they are; the last frame takes the rest. Two samples of an edge with one stamp
    count once where they agree; where they differ the edge is lost. ``cautery()`` is its state at
    the arrival of the first sample of a frame; None for a recording without it.
    """

    def __init__(
        self, note: Callable[[str], None], cautery: Callable[[], CauteryState] | None = None
    ) -> None:
        self._note = note
        self._cautery = cautery
        self._drafts: dict[int, _Draft] = {}
        self._order: list[int] = []  # stamps of the drafts, sorted
        self._joints: list[JointSample] = []  # sorted by stamp
        self._joints_dropped = False
        self._contradiction_noted = False
        self._newest_ns: int | None = None

    def add_pose(self, sample: TrackedTransform) -> Iterable[TrackingFrame]:
        """Add a sample; return the frames that are complete now."""
        stamp, edge = sample.stamp, (sample.target, sample.source)
        draft = self._drafts.get(stamp.ns)
        if draft is None:
            finished = self._begin(stamp.ns)
            cautery = None if self._cautery is None else self._cautery()
            self._drafts[stamp.ns] = _Draft(stamp, {edge: sample}, cautery=cautery)
            insort_right(self._order, stamp.ns)
            return finished
        known = draft.poses.get(edge)
        draft.poses[edge] = sample if known is None else self._agreed(known, sample)
        return ()

    def _begin(self, ns: int) -> list[TrackingFrame]:
        """The frames that are complete once a sample of ``ns`` has arrived."""
        newest = ns if self._newest_ns is None else max(ns, self._newest_ns)
        if ns < newest - REORDER_NS:
            finished = list(self.flush())
            newest = ns
        else:
            complete = bisect_left(self._order, newest - REORDER_NS)
            complete = max(complete, len(self._order) - _MAX_PENDING_FRAMES)
            finished = [self._finished(stamp) for stamp in self._order[:complete]]
            del self._order[:complete]
        self._newest_ns = newest
        return finished

    def _agreed(self, known: TrackedTransform, sample: TrackedTransform) -> TrackedTransform:
        agreed = agreed_sample(known, sample)
        contradicts = known.transform is not None and sample.transform is not None
        if contradicts and agreed is not known and not self._contradiction_noted:
            self._note(
                f"{sample.target} -> {sample.source} has two poses at {sample.stamp.ns} ns: "
                "such samples are INVALID"
            )
            self._contradiction_noted = True
        return agreed

    def add_unfiltered(self, stamp: Stamp, unfiltered: Stamp) -> None:
        """Add the second clock's time of the samples acquired at ``stamp``."""
        draft = self._drafts.get(stamp.ns)
        if draft is not None:
            draft.unfiltered = unfiltered

    def add_joints(self, sample: JointSample) -> Iterable[TrackingFrame]:
        """Add a joint sample, its stamp on the tracker's clock; it completes no frame."""
        if self._joints and sample.stamp.ns < self._joints[-1].stamp.ns:
            insort_right(self._joints, sample, key=_ns)
        else:
            self._joints.append(sample)
        if len(self._joints) > _MAX_PENDING_JOINTS:
            del self._joints[: _MAX_PENDING_JOINTS // 2]
            if not self._joints_dropped:
                self._note(
                    "joint states run far ahead of the tracker, the oldest are skipped: "
                    "clock.offset_robot_to_tracker_ms may be wrong"
                )
            self._joints_dropped = True
        return ()

    def flush(self) -> Iterator[TrackingFrame]:
        """Yield all buffered frames, at the end or after a jump of the clock."""
        stamps, self._order = self._order, []
        for stamp in stamps:
            yield self._finished(stamp, last=stamp == stamps[-1])

    def _finished(self, ns: int, *, last: bool = False) -> TrackingFrame:
        draft = self._drafts.pop(ns)
        count = len(self._joints) if last else bisect_right(self._joints, ns, key=_ns)
        joints = tuple(self._joints[:count])
        del self._joints[:count]
        poses = tuple(draft.poses.values())
        return TrackingFrame(draft.stamp, poses, joints, draft.unfiltered, draft.cautery)


def agreed_sample(known: TrackedTransform, sample: TrackedTransform) -> TrackedTransform:
    """Merge two samples of one edge and stamp: INVALID where their poses differ."""
    if known.transform is None:
        return known
    if sample.transform is None:
        return sample
    if np.array_equal(known.transform.matrix, sample.transform.matrix):
        return known
    return TrackedTransform.lost(sample.target, sample.source, sample.stamp, TrackingStatus.INVALID)


def _ns(sample: JointSample) -> int:
    return sample.stamp.ns
