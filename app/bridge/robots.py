"""Follow a robot on the ROS graph: the poses of its links, from joint states."""

import math
import threading
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState

from app.bridge.messages import ns_of
from app.bridge.robot_description import RobotSettings
from app.bridge.ros_errors import TfError
from app.bridge.tf import TransformBuffer
from app.geometry import NS_PER_MS, FloatArray, Freshness, FreshnessLimits, freshness_of
from app.robot import JointError, Robot

_NAMES_SHOWN = 5

_MAX_BYTES = 1 << 18
"""Room for thousands of joints."""


@dataclass(frozen=True, slots=True, eq=False)
class RobotState:
    """``root_from_link`` of every link at one time.

    ``poses`` is (n, 4, 4) in mm, read-only, in the order of ``links``. It is None before the first
    poses, and holds the last ones while ``is_stale``. ``stamp_ns`` is that of the oldest sample
    used; None if all of them are static. ``problems`` lists descriptions of problems; not all of
    them make the poses stale.
    """

    links: tuple[str, ...]
    poses: FloatArray | None
    stamp_ns: int | None
    is_stale: bool
    problems: tuple[str, ...] = ()


def age_problem(stamp_ns: int | None, now_ns: int, limits: FreshnessLimits) -> str:
    """The reason why a state with ``stamp_ns`` is not valid at ``now_ns``; empty if it is valid.

    A state without a stamp consists of static edges and is valid at any time.
    """
    if stamp_ns is None or freshness_of(stamp_ns, now_ns, limits) is Freshness.VALID:
        return ""
    age_ms = (now_ns - stamp_ns) / NS_PER_MS
    if age_ms < 0.0:
        allowed_ms = limits.future_tolerance_ns / NS_PER_MS
        return f"the state is {-age_ms:.0f} ms in the future; expected at most {allowed_ms:.0f} ms"
    allowed_ms = limits.stale_after_ns / NS_PER_MS
    return f"the state is {age_ms:.0f} ms old; expected at most {allowed_ms:.0f} ms"


@dataclass(frozen=True, slots=True)
class _Sample:
    position: float
    stamp_ns: int


class JointFollower:
    """Computes link poses from joint states. `receive` and `state` may run in different threads.

    A joint state may contain a subset of the joints, as an arm and its gripper have separate
    drivers. Each joint keeps its latest position, and the state is as old as the oldest position it
    needs.

    ``buffer`` locates the robot's root in a fixed frame other than the root: at the time of the
    positions, or at the newest transform if that is older, which the state's stamp then is. Without
    a buffer, such a frame is reported as a problem.

    Messages over 256 kB are ignored and counted in `refused`, as are invalid ones, which the
    state's problems list: duplicate names, different numbers of names and positions, a stamp of 0.
    Names of unknown joints are listed as a problem. The state is stale while a joint has no
    position, a position that is not finite, too old, or from the future.
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
        self._unknown_joints = ""
        self._last: tuple[FloatArray, int | None] | None = None

    def receive(self, raw: bytes) -> None:
        """Process a serialised ``JointState``."""
        if len(raw) > _MAX_BYTES:
            self.refused += 1
            return
        message: JointState = deserialize_message(raw, JointState)
        self.take(message.name, message.position, ns_of(message.header.stamp))

    def take(self, names: Sequence[str], positions: Sequence[float], stamp_ns: int) -> None:
        """Process one message; positions are in rad, or m for prismatic joints."""
        with self._lock:
            self._refusal = _refusal_of(names, positions, stamp_ns)
            if self._refusal:
                self.refused += 1
                return
            unknown = [name for name in names if name not in self._moving]
            self._unknown_joints = (
                f"joints unknown to the robot: {_some(unknown)}" if unknown else ""
            )
            for name, position in zip(names, positions, strict=True):
                if name in self._moving:
                    self._insert(name, float(position), stamp_ns)

    def state(self, now_ns: int) -> RobotState:
        """Link poses from the latest positions; stale with the previous poses on a problem."""
        with self._lock:
            samples, problems = self._usable(), self._position_problems()
            notes = [text for text in (self._refusal, self._unknown_joints) if text]
        stamp_ns = min((sample.stamp_ns for sample in samples.values()), default=None)
        if not problems:
            try:
                self._last = self._poses(samples, stamp_ns)
            except (JointError, TfError) as error:
                problems.append(str(error))
        poses_now, stamp_now = self._last or (None, None)
        limits = self._settings.freshness_limits
        old = age_problem(stamp_now, now_ns, limits)
        if old:
            problems.append(f"{old}{self._oldest(samples, stamp_now)}")
        else:  # only the oldest sample has been checked so far
            future = [
                name
                for name, sample in samples.items()
                if freshness_of(sample.stamp_ns, now_ns, limits) is Freshness.FUTURE
            ]
            if future:
                problems.append(f"joints whose position is from the future: {_some(future)}")
        return RobotState(self._links, poses_now, stamp_now, bool(problems), (*problems, *notes))

    def _oldest(self, samples: dict[str, _Sample], stamp_ns: int | None) -> str:
        """The joint or transform that the pose is as old as, in parentheses; else empty."""
        if not samples:
            return ""
        oldest = min(samples, key=lambda name: samples[name].stamp_ns)
        if stamp_ns is not None and stamp_ns < samples[oldest].stamp_ns:
            root_frame = self._settings.frame(self._robot.root_link)
            return f" (transform of {root_frame!r} in {self._root!r})"
        return f" (joint {oldest!r})"

    def _insert(self, name: str, position: float, stamp_ns: int) -> None:
        last = self._samples.get(name)
        # Slightly older: it arrived late. Much older: the source was restarted.
        if last is not None and 0 < last.stamp_ns - stamp_ns <= self._settings.stale_after_ns:
            return
        if math.isfinite(position):
            self._samples[name] = _Sample(position, stamp_ns)
            self._not_finite.pop(name, None)
        else:
            self._not_finite[name] = position

    def _usable(self) -> dict[str, _Sample]:
        """All samples but outdated ones of mimic joints, whose positions are not needed."""
        limits = self._settings.freshness_limits
        newest_ns = max((sample.stamp_ns for sample in self._samples.values()), default=0)
        return {
            name: sample
            for name, sample in self._samples.items()
            if name in self._needed
            or freshness_of(sample.stamp_ns, newest_ns, limits) is Freshness.VALID
        }

    def _position_problems(self) -> list[str]:
        """Problems of the positions that do not depend on the time."""
        missing = [name for name in self._needed if name not in self._samples]
        problems = [f"joints without a position: {_some(missing)}"] if missing else []
        if self._not_finite:
            problems.append(f"joints whose position is not finite: {_some(list(self._not_finite))}")
        return problems

    def _poses(
        self, samples: dict[str, _Sample], stamp_ns: int | None
    ) -> tuple[FloatArray, int | None]:
        """Link poses, and the stamp of the older of joints and root."""
        links = self._robot.forward_kinematics(
            {name: sample.position for name, sample in samples.items()}
        )
        poses = np.array([links[name].matrix for name in self._links])
        root_frame = self._settings.frame(self._robot.root_link)
        if self._root != root_frame:
            if self._buffer is None:
                raise JointError(
                    f"the pose of {root_frame!r} in {self._root!r} is unknown; "
                    "expected a tf buffer that provides it"
                )
            # A static transform has no stamp and is valid at any time. A joint state often arrives
            # before the transform of the same time: then the newest transform is used.
            newest_ns = self._buffer.latest_common_ns(self._root, root_frame)
            if newest_ns is None:
                at_ns = None
            else:
                at_ns = stamp_ns = newest_ns if stamp_ns is None else min(stamp_ns, newest_ns)
            poses = self._buffer.lookup(self._root, root_frame, at_ns).transform.matrix @ poses
        poses.flags.writeable = False
        return poses, stamp_ns


def _refusal_of(names: Sequence[str], positions: Sequence[float], stamp_ns: int) -> str:
    """The reason why a joint state is invalid; empty if it is valid."""
    if len(names) != len(positions):
        return (
            f"a joint state has {len(names)} names and {len(positions)} positions; "
            "expected as many positions as names"
        )
    if len(set(names)) != len(names):
        return "a joint state has duplicate joint names; expected unique names"
    if stamp_ns <= 0:
        return f"a joint state has the stamp {stamp_ns} ns; expected the time of measurement"
    return ""


def _some(names: Sequence[str]) -> str:
    shown = ", ".join(name[:60] for name in names[:_NAMES_SHOWN])
    return f"{shown} and {len(names) - _NAMES_SHOWN} more" if len(names) > _NAMES_SHOWN else shown
