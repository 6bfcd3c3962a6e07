"""Plays a recording as live samples: each when it is due, with its stamp moved to the present.

The clocks are passed in, as for the `Player`, which times the samples.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

from app.case.frames.player import Player, Source, Wait, checked_rate, wait_on_event
from app.case.frames.samples import JointSample, TrackingFrame
from app.geometry import NS_PER_S, InputError, Stamp, TrackedTransform


@dataclass(frozen=True, slots=True, eq=False)
class PlayedSamples:
    """Samples that are due. ``poses``: all of one acquisition stamp, on the host's clock.

    ``joints``: on the robot's clock, whose recorded offset from the tracker's is kept.
    """

    poses: tuple[TrackedTransform, ...] = ()
    joints: tuple[JointSample, ...] = ()


class Playback:
    """Yields the samples of ``source`` with the intervals between their stamps as recorded.

    ``source`` yields the recording's own frames, with joints on the tracker's clock, from which
    ``offset_robot_to_tracker_ns`` is subtracted again. ``clock_ns`` is a steady clock, ``host_ns``
    the clock of the moved stamps. At ``rate`` 2 intervals are half as long as recorded. The
    recording starts ``start_s`` after its first sample.

    With ``loop`` it starts again ``pause_ns`` after its last sample, so that stamps increase across
    the seam. During the pause nothing is yielded: a pause longer than the limit for stale poses
    shows a session that the poses before and after it do not follow from each other.

    A recorded clock that jumps back does so here too. Raises `InputError` for a rate or a start
    that is out of range; `play` raises it for a recording that ends before ``start_s``.
    """

    def __init__(
        self,
        source: Source,
        *,
        offset_robot_to_tracker_ns: int,
        clock_ns: Callable[[], int],
        host_ns: Callable[[], int],
        rate: float = 1.0,
        loop: bool = False,
        start_s: float = 0.0,
        pause_ns: int = NS_PER_S,
        wait: Wait = wait_on_event,
    ) -> None:
        if not 0.0 <= start_s <= 1e9:
            raise InputError(f"start of a playback is {start_s} s; expected 0 to 1e9 s")
        self._source = source
        self._offset_ns = offset_robot_to_tracker_ns
        self._host_ns = host_ns
        checked_rate(rate)
        self._rate = rate
        self._loop = loop
        self._start_ns = round(start_s * NS_PER_S)
        self._pause_ns = round(pause_ns * rate)
        self._player = Player(self._passes, clock_ns=clock_ns, rate=rate, wait=wait)
        self._origin_ns: int | None = None
        """Stamp of the first sample of the first pass, which is played at ``_began_ns``."""
        self._began_ns = 0
        self._shift_ns = 0

    def play(self) -> Iterator[PlayedSamples]:
        """Yield the samples when they are due, until the recording ends or `stop`."""
        for frame in self._player.play():
            yield PlayedSamples(
                tuple(_moved(sample, self._moved_ns(sample.stamp.ns)) for sample in frame.poses),
                tuple(self._moved_joints(sample) for sample in frame.joints),
            )

    def stop(self) -> None:
        """End `play` at once, also while it waits. Thread-safe."""
        self._player.stop()

    def _passes(self) -> Iterator[TrackingFrame]:
        """The recording, repeated with ``loop``; the frames' own stamps increase over all passes.

        The player takes the next frame only after the one before has been yielded, so `_shift_ns`
        is that of the yielded frame.
        """
        while True:
            first_ns = newest_ns = None
            for frame in single_samples(self._source()):
                ns = frame.stamp.ns
                first_ns = ns if first_ns is None else first_ns
                if ns - first_ns < self._start_ns:
                    continue
                if self._origin_ns is None:
                    # Read before the player starts its time: no stamp is in the future.
                    self._origin_ns, self._began_ns = ns, self._host_ns()
                newest_ns = ns if newest_ns is None else max(newest_ns, ns)
                yield replace(frame, stamp=Stamp(ns + self._shift_ns, frame.stamp.clock))
            if newest_ns is None or self._origin_ns is None:
                raise InputError(
                    f"start of a playback is {self._start_ns / NS_PER_S:g} s; "
                    "expected a time before the end of the recording"
                )
            if not self._loop:
                return
            self._shift_ns += newest_ns - self._origin_ns + self._pause_ns

    def _moved_ns(self, ns: int) -> int:
        """Time on the host's clock at which a sample stamped ``ns`` in this pass is due."""
        played_ns = ns + self._shift_ns - (self._origin_ns or 0)
        return self._began_ns + round(played_ns / self._rate)

    def _moved_joints(self, sample: JointSample) -> JointSample:
        stamp = Stamp(self._moved_ns(sample.stamp.ns) - self._offset_ns, sample.stamp.clock)
        return JointSample.unchecked(sample.names, sample.positions, stamp)


def single_samples(frames: Iterator[TrackingFrame]) -> Iterator[TrackingFrame]:
    """Yield each joint sample and each group of poses of ``frames`` as a frame, ordered by stamp.

    A driver sends each sample when it is measured; a frame holds the joints since the last one. A
    joint sample that is older than the frame before it was late and is yielded at once.
    """
    newest_ns: int | None = None
    for frame in frames:
        poses = [TrackingFrame(frame.stamp, frame.poses)] if frame.poses else []
        for each in sorted(
            [*(TrackingFrame(sample.stamp, (), (sample,)) for sample in frame.joints), *poses],
            key=lambda item: item.stamp.ns,
        ):
            if each.joints and newest_ns is not None and each.stamp.ns < newest_ns:
                yield TrackingFrame(Stamp(newest_ns, each.stamp.clock), (), each.joints)
                continue
            newest_ns = each.stamp.ns
            yield each


def _moved(sample: TrackedTransform, ns: int) -> TrackedTransform:
    """``sample`` stamped ``ns``, with its status."""
    stamp = Stamp(ns, sample.stamp.clock)
    if sample.transform is not None:
        return TrackedTransform.valid(sample.transform, stamp)
    return TrackedTransform.lost(sample.target, sample.source, stamp, sample.status)
