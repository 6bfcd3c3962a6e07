"""Oracle of which frames may not give a known margin state.

Independent of `app.session`: it keeps every sample that was ever sent and examines all of them at
each frame. It has no tree of poses and no counters, and shares with the session only the numbers in
the frames and the margin parameters.
"""

import math
from dataclasses import dataclass, field

from app.case import JointSample
from app.case.messages.message_values import PoseValues
from app.geometry import TrackingStatus
from tests.doubles import PARAMETERS


@dataclass(frozen=True)
class SentSample:
    """A sample as a driver sends it, in frame number ``frame``; its values may be invalid."""

    source: str
    frame: int
    values: PoseValues

    @property
    def is_pose(self) -> bool:
        """True for a finite, rigid pose with status OK within 10 m of the tracker."""
        numbers = (*self.values.translation_m, *self.values.quaternion)
        return (
            self.values.status == TrackingStatus.OK
            and all(map(math.isfinite, numbers))
            and math.isclose(math.hypot(*self.values.quaternion), 1.0, rel_tol=1e-6)
            and max(map(abs, self.values.translation_m)) <= 10.0
        )


@dataclass
class MarginTrustOracle:
    """Decides from all frames sent so far whether the state is UNKNOWN and held.

    ``sources`` are the tracked frames that the decision needs; ``registered`` is False for a robot
    without an accepted registration. ``checked_by_joints``: a robot's joints must be known too.
    ``held`` is the latch, released by the test's operator.
    """

    sources: tuple[str, ...]
    registered: bool
    checked_by_joints: bool = False
    joints: JointSample | None = None
    frames_ns: list[int] = field(default_factory=list)
    sent: list[SentSample] = field(default_factory=list)
    bad: list[bool] = field(default_factory=list)
    held: bool = False

    def observe(
        self, now_ns: int, sent: list[SentSample], joints: tuple[JointSample, ...] = ()
    ) -> None:
        """Add a frame at ``now_ns`` with its samples."""
        self.joints = joints[-1] if joints else self.joints
        jumped = bool(self.frames_ns) and now_ns < self.frames_ns[-1]
        self.frames_ns.append(now_ns)
        self.sent += sent
        begin = self._since_jump()
        bad = jumped or not self.registered
        # No frame came before the last known margin became too old.
        if len(self.frames_ns) > 1 and not self.is_unknown():
            bad |= now_ns - self.frames_ns[-2] > PARAMETERS.stale_after_ns
        bad |= self.checked_by_joints and not self._are_joints_known(now_ns)
        bad |= any(self._is_bad(source, now_ns, begin) for source in self.sources)
        self.held |= bad and not all(self.bad)
        self.bad.append(bad)

    def is_unknown(self) -> bool:
        """True until the first good frame, and until enough good ones in a row after a bad one."""
        if all(self.bad):
            return True
        first = self.bad.index(False)
        return any(self.bad[first:][-PARAMETERS.release_samples :])

    def latest(self, source: str) -> PoseValues:
        """Values of the latest accepted sample of ``source``."""
        return self._accepted(source, self._since_jump())[-1].values

    def _are_joints_known(self, now_ns: int) -> bool:
        if self.joints is None or not all(map(math.isfinite, self.joints.positions)):
            return False
        return 0 <= now_ns - self.joints.stamp.ns <= PARAMETERS.stale_after_ns

    def _since_jump(self) -> int:
        """Index of the first frame since the clock last went back."""
        frames = self.frames_ns
        return max((i for i in range(1, len(frames)) if frames[i] < frames[i - 1]), default=0)

    def _accepted(self, source: str, begin: int) -> list[SentSample]:
        """Samples since frame ``begin``, without those that came after newer ones."""
        accepted: list[SentSample] = []
        for sample in self.sent:
            if sample.source != source or sample.frame < begin:
                continue
            now_ns = self.frames_ns[sample.frame]
            if accepted and sample.values.ns < accepted[-1].values.ns <= now_ns:
                continue
            accepted.append(sample)
        return accepted

    def _is_bad(self, source: str, now_ns: int, begin: int) -> bool:
        accepted = self._accepted(source, begin)
        if not accepted or not accepted[-1].is_pose:
            return True
        age_ns = now_ns - accepted[-1].values.ns
        if not 0 <= age_ns <= PARAMETERS.stale_after_ns:
            return True
        poses = [sample for sample in accepted if sample.is_pose]
        same = [numbers_of(pose.values) == numbers_of(poses[-1].values) for pose in poses]
        run = poses[len(poses) - [*same[::-1], False].index(False) :]
        # A pose cannot have been acquired after its frame, whatever its stamp.
        since_ns = min(run[0].values.ns, self.frames_ns[run[0].frame])
        return run[-1].values.ns - since_ns > PARAMETERS.frozen_after_ns


def numbers_of(values: PoseValues) -> tuple[float, ...]:
    """Translation and quaternion of a sample."""
    return (*values.translation_m, *values.quaternion)
