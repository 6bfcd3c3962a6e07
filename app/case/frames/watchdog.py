"""Inserts frames without poses into gaps of a recording, so that a replay sees the gap."""

from collections.abc import Iterator
from dataclasses import replace

from app.case.frames.cautery import CauteryState
from app.case.frames.samples import JointSample, TrackingFrame
from app.geometry import Freshness, FreshnessLimits, freshness_of


def with_watchdog(frames: Iterator[TrackingFrame], stale_after_ns: int) -> Iterator[TrackingFrame]:
    """Yield ``frames``, and one frame without poses in each gap longer than ``stale_after_ns``.

    A replay steps from frame to frame: without the inserted frame its time would stop in a gap and
    the last margin would remain displayed. The watchdog frame is stamped one nanosecond after the
    last frame became stale and takes the joints that were read up to then. The same is done at the
    end, where joints continue after the last frame of the tracker.
    """
    limits = FreshnessLimits(stale_after_ns)
    last_ns: int | None = None
    for frame in frames:
        if last_ns is not None and freshness_of(last_ns, frame.stamp.ns, limits) is Freshness.STALE:
            early, late = _split(frame.joints, last_ns + stale_after_ns + 1)
            yield _watchdog(frame, last_ns + stale_after_ns + 1, early)
            frame = replace(frame, joints=late)
        last_ns = frame.stamp.ns
        before, after = _split(frame.joints, last_ns + stale_after_ns)
        yield replace(frame, joints=before) if after else frame
        if after:
            yield _watchdog(frame, last_ns + stale_after_ns + 1, after)


def _watchdog(
    frame: TrackingFrame, stamp_ns: int, joints: tuple[JointSample, ...]
) -> TrackingFrame:
    cautery = None if frame.cautery is None else CauteryState.UNKNOWN
    return TrackingFrame(replace(frame.stamp, ns=stamp_ns), (), joints, cautery=cautery)


def _split(
    joints: tuple[JointSample, ...], until_ns: int
) -> tuple[tuple[JointSample, ...], tuple[JointSample, ...]]:
    late = [sample for sample in joints if sample.stamp.ns > until_ns]
    if not late:
        return joints, ()
    return tuple(sample for sample in joints if sample.stamp.ns <= until_ns), tuple(late)
