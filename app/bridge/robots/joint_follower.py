"""A robot that follows joint states: forward kinematics of the newest position of every joint.

Positions may come in any order and in parts (an arm's driver and its gripper's), so each joint
keeps its last one and the state is as old as the oldest that it needs.
"""

import math
import threading
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from app.bridge.robots.settings import RobotSettings
from app.bridge.robots.state import RobotState, age_problem
from app.bridge.tf import TfError, TransformBuffer
from app.geometry import FloatArray, Freshness, freshness_of
from app.robot import JointError, Robot

_NAMES_SHOWN = 5


@dataclass(frozen=True, slots=True)
class _Sample:
    position: float
    stamp_ns: int


class JointFollower:
    """`take` is for the thread that receives, `state` for the one that shows.

    ``buffer`` says where the robot's root is in a fixed frame that is another; without it such a
    frame is a problem. What cannot be used is left out, counted in `refused` and in words among
    the state's problems: names of no joint, two of one name, a position too many or too few, a
    stamp of 0. The robot is stale while a joint has no position, or one that is no number, or one
    that is too old or from the future.
    """

    def __init__(
        self, robot: Robot, settings: RobotSettings, buffer: TransformBuffer | None = None
    ) -> None:
        self.refused = 0
        self._robot = robot
        self._settings = settings
        self._buffer = buffer
        self._root = settings.root_frame(robot)
        self._links = tuple(link.name for link in robot.links)
        self._moving = {joint.name for joint in robot.joints if joint.moves}
        self._needed = robot.actuated_joint_names
        self._lock = threading.Lock()
        self._samples: dict[str, _Sample] = {}
        self._not_finite: dict[str, float] = {}
        self._refusal = ""
        self._extra = ""
        self._last: tuple[FloatArray, int | None] | None = None

    def take(self, names: Sequence[str], positions: Sequence[float], stamp_ns: int) -> None:
        """Take one message in: rad, m for sliding joints, as ROS has them."""
        with self._lock:
            self._refusal = self._refused(names, positions, stamp_ns)
            if self._refusal:
                self.refused += 1
                return
            extra = [name for name in names if name not in self._moving]
            self._extra = f"joints that the robot has not: {_some(extra)}" if extra else ""
            for name, position in zip(names, positions, strict=True):
                if name in self._moving:
                    self._insert(name, float(position), stamp_ns)

    def state(self, now_ns: int) -> RobotState:
        """The links where the newest positions put them."""
        with self._lock:
            samples, stopping = self._usable(), self._stopping()
            said = [text for text in (self._refusal, self._extra) if text]
        stamp_ns = min((sample.stamp_ns for sample in samples.values()), default=None)
        if not stopping:
            try:
                poses = self._poses(samples, stamp_ns)
                self._last = (poses, stamp_ns)
            except (JointError, TfError) as error:
                stopping.append(str(error))
        poses_now, stamp_now = self._last or (None, None)
        limits = self._settings.freshness_limits
        old = age_problem(stamp_now, now_ns, limits)
        if old:
            oldest = min(samples, key=lambda name: samples[name].stamp_ns, default="")
            stopping.append(f"{old} (joint {oldest!r})" if oldest else old)
        else:  # the oldest of them alone is known to be fresh
            future = [
                name
                for name, sample in samples.items()
                if freshness_of(sample.stamp_ns, now_ns, limits) is Freshness.FUTURE
            ]
            if future:
                stopping.append(f"joints whose position is from the future: {_some(future)}")
        return RobotState(
            self._root, self._links, poses_now, stamp_now, bool(stopping), (*stopping, *said)
        )

    def _refused(self, names: Sequence[str], positions: Sequence[float], stamp_ns: int) -> str:
        if len(names) != len(positions):
            return f"a joint state has {len(names)} names and {len(positions)} positions"
        if len(set(names)) != len(names):
            return "a joint state names a joint twice"
        if stamp_ns <= 0:
            return f"a joint state has the stamp {stamp_ns} ns: when it was measured is wanted"
        return ""

    def _insert(self, name: str, position: float, stamp_ns: int) -> None:
        last = self._samples.get(name)
        # A little older: it came late. Much older: the source was started again.
        if last is not None and 0 < last.stamp_ns - stamp_ns <= self._settings.stale_after_ns:
            return
        if math.isfinite(position):
            self._samples[name] = _Sample(position, stamp_ns)
            self._not_finite.pop(name, None)
        else:
            self._not_finite[name] = position

    def _usable(self) -> dict[str, _Sample]:
        """All but the followers of others (mimic) that were told once and then no more."""
        limits = self._settings.freshness_limits
        newest_ns = max((sample.stamp_ns for sample in self._samples.values()), default=0)
        return {
            name: sample
            for name, sample in self._samples.items()
            if name in self._needed
            or freshness_of(sample.stamp_ns, newest_ns, limits) is Freshness.VALID
        }

    def _stopping(self) -> list[str]:
        """What makes the positions unusable, whatever the time."""
        missing = [name for name in self._needed if name not in self._samples]
        stopping = [f"joints without a position: {_some(missing)}"] if missing else []
        if self._not_finite:
            stopping.append(f"joints whose position is no number: {_some(list(self._not_finite))}")
        return stopping

    def _poses(self, samples: dict[str, _Sample], stamp_ns: int | None) -> FloatArray:
        links = self._robot.forward_kinematics(
            {name: sample.position for name, sample in samples.items()}
        )
        poses = np.array([links[name].matrix for name in self._links])
        root_frame = self._settings.frame(self._robot.root_link)
        if self._root != root_frame:
            if self._buffer is None:
                raise JointError(
                    f"joint states cannot tell where {root_frame!r} is in {self._root!r}: tf wanted"
                )
            # Mostly it is fixed, and then it holds at any time.
            newest_ns = self._buffer.latest_common_ns(self._root, root_frame)
            at_ns = stamp_ns if newest_ns is not None else None
            poses = self._buffer.lookup(self._root, root_frame, at_ns).transform.matrix @ poses
        poses.flags.writeable = False
        return poses


def _some(names: Sequence[str]) -> str:
    shown = ", ".join(name[:60] for name in names[:_NAMES_SHOWN])
    return f"{shown} and {len(names) - _NAMES_SHOWN} more" if len(names) > _NAMES_SHOWN else shown
