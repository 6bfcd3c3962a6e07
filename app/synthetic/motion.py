"""Motion over time: smooth paths, the joints of an arm that follows one, and breathing."""

from bisect import bisect_right
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import BPoly, PchipInterpolator
from scipy.spatial.transform import Rotation

from app.files.paths import shipped
from app.geometry import FloatArray, InputError, Transform, mismatched_frames
from app.geometry.rotations import rotation_of_vector
from app.robot import load_robot
from app.synthetic.tumour_and_tool import BASE_FRAME, TIP_FRAME, TOOL_LINK

MAX_TURN_RAD = 2.5
"""Rotation vectors are smooth below pi; this leaves a margin."""
_HELD_MM = 1e-9
TOUCH_URDF = shipped("data", "robots", "touch", "touch.urdf")


@dataclass(frozen=True, slots=True, eq=False)
class Poses:
    """``target_from_source`` at n times: rotations (n, 3, 3) and translations (n, 3) in mm.

    The operations are those of `Transform`, on arrays; one transform is combined with all.
    """

    target: str
    source: str
    rotations: FloatArray
    translations_mm: FloatArray

    @classmethod
    def of(cls, transforms: Sequence[Transform]) -> "Poses":
        """Poses from n > 0 transforms between the same frames."""
        first = transforms[0]
        return cls(
            first.target,
            first.source,
            np.array([each.rotation for each in transforms]),
            np.array([each.translation_mm for each in transforms]),
        )

    def __matmul__(self, other: "Poses") -> "Poses":
        if self.source != other.target:
            raise mismatched_frames((self.target, self.source), (other.target, other.source))
        return Poses(
            self.target,
            other.source,
            np.matmul(self.rotations, other.rotations),
            _rotated(self.rotations, other.translations_mm) + self.translations_mm,
        )

    def inverse(self) -> "Poses":
        """Return ``source_from_target``."""
        rotations = np.ascontiguousarray(self.rotations.transpose(0, 2, 1))
        return Poses(
            self.source, self.target, rotations, -_rotated(rotations, self.translations_mm)
        )

    def apply(self, points_mm: FloatArray) -> FloatArray:
        """Map points (k, 3) in mm at each time: (n, k, 3)."""
        moved = np.matmul(points_mm, self.rotations.transpose(0, 2, 1))
        return np.asarray(moved + self.translations_mm[:, None])

    def transforms(self) -> list[Transform]:
        """Each pose as a `Transform`; the arrays become read-only."""
        self.rotations.setflags(write=False)
        self.translations_mm.setflags(write=False)
        return [
            Transform.of_read_only(self.target, self.source, rotation, translation_mm)
            for rotation, translation_mm in zip(self.rotations, self.translations_mm, strict=True)
        ]


def _rotated(rotations: FloatArray, vectors: FloatArray) -> FloatArray:
    return np.asarray(np.matmul(rotations, vectors[:, :, None])[:, :, 0])


@dataclass(frozen=True, slots=True, eq=False)
class Waypoint:
    """Pose of the tool at ``time_s``, and velocity (3,) of its origin in mm/s."""

    time_s: float
    pose: Transform
    velocity_mm_s: FloatArray


class Path:
    """Smooth motion through waypoints, with zero acceleration at each of them.

    Positions are quintic between waypoints: with rest at both ends that is the minimum-jerk
    trajectory (Flash and Hogan 1985). Rotations are monotone cubic in the rotation vector from the
    first waypoint's rotation, so that a held rotation is exactly constant; its length must stay
    within `MAX_TURN_RAD`.
    """

    def __init__(self, waypoints: Sequence[Waypoint]) -> None:
        times = np.array([waypoint.time_s for waypoint in waypoints])
        if len(times) < 2 or (np.diff(times) <= 0.0).any():
            raise InputError(f"waypoint times are {times.tolist()}; expected two or more, rising")
        self._first = waypoints[0].pose
        inverse = self._first.rotation.T
        turns = Rotation.from_matrix([inverse @ w.pose.rotation for w in waypoints]).as_rotvec()
        max_turn = float(np.linalg.norm(turns, axis=1).max())
        if max_turn > MAX_TURN_RAD:
            raise InputError(
                f"a waypoint is rotated by {max_turn:.3f} rad from the first; "
                f"expected {MAX_TURN_RAD} or less"
            )
        states = [
            np.stack([w.pose.translation_mm, w.velocity_mm_s, np.zeros(3)]) for w in waypoints
        ]
        self._turns = PchipInterpolator(times, turns)
        self._positions = BPoly.from_derivatives(times, states)
        self.start_s, self.end_s = float(times[0]), float(times[-1])

    def at(self, time_s: float) -> Transform:
        """The pose at ``time_s``, constant before the first and after the last waypoint."""
        return self.poses(np.array([time_s]))[0]

    def poses(self, times_s: FloatArray) -> list[Transform]:
        """The poses at ``times_s`` (n,), constant before the first and after the last waypoint."""
        within = np.minimum(np.maximum(times_s, self.start_s), self.end_s)
        return [
            Transform.unchecked(
                self._first.target,
                self._first.source,
                self._first.rotation @ rotation_of_vector(turn),
                np.array(position),
            )
            for turn, position in zip(self._turns(within), self._positions(within), strict=True)
        ]


class JointMotion:
    """An arm that follows a path: joints at knots by inverse kinematics, smooth in between.

    Between knots the joints are monotone cubic, so that a held pose is exactly constant. The true
    motion is the forward kinematics of these joints; the path is only its set point.
    """

    def __init__(self, arm: "TouchArm", times_s: FloatArray, poses: Sequence[Transform]) -> None:
        self.joint_names = tuple(arm.joint_names)
        self._arm = arm
        self._span_s = (float(times_s[0]), float(times_s[-1]))
        knots = np.empty((len(times_s), len(self.joint_names)))
        joints: Mapping[str, float] | None = None
        reached: Transform | None = None
        for row, pose in enumerate(poses):
            # A held pose keeps its joints: repeated inverse kinematics would let them drift.
            moved = reached is None or np.abs(reached.matrix - pose.matrix).max() >= _HELD_MM
            if joints is None or moved:
                joints, reached = arm.joints_for(pose, joints), pose
            knots[row] = [joints[name] for name in self.joint_names]
        self._positions = PchipInterpolator(times_s, knots)
        self._knots_s: list[float] = times_s.tolist()
        self._last: tuple[float, Transform] | None = None

    def positions(self, time_s: float | FloatArray) -> FloatArray:
        """Joint positions (n,) in the order of ``joint_names``, constant beyond both ends.

        (k, n) for times (k,).
        """
        low, high = self._span_s
        if isinstance(time_s, float):
            return self._positions_at(min(max(time_s, low), high))
        within = np.minimum(np.maximum(time_s, low), high)
        return np.asarray(self._positions(within), dtype=np.float64)

    def _positions_at(self, time_s: float) -> FloatArray:
        """Joint positions (n,), in the operations of scipy, whose call for one time takes longer.

        A case has thousands of single times, and an array of them the same bits.
        """
        part = min(bisect_right(self._knots_s, time_s), len(self._knots_s) - 1) - 1
        third, second, first, start = self._positions.c[:, part]
        since = time_s - self._knots_s[part]
        power = since * since
        return np.asarray(start + first * since + second * power + third * (power * since))

    def base_from_tool(self, time_s: float) -> Transform:
        """The true pose of the tool."""
        if self._last is None or self._last[0] != time_s:
            joints = dict(zip(self.joint_names, self.positions(time_s).tolist(), strict=True))
            self._last = time_s, self._arm.base_from_tool(joints)
        return self._last[1]

    def base_from_tools(self, times_s: FloatArray) -> Poses:
        """The true poses of the tool at ``times_s`` (n,)."""
        names = self.joint_names
        return Poses.of(
            [
                self._arm.base_from_tool(dict(zip(names, row, strict=True)))
                for row in self.positions(times_s).tolist()
            ]
        )


# The patient is ventilated. During registration the breath is held at end expiration, where every
# body is at its rest pose; then breathing starts.


@dataclass(frozen=True, slots=True)
class Breathing:
    """Depth of breath over time: 0 at end expiration, 1 at full inspiration.

    ``sin^4(pi f t)``: the model of Lujan et al. 1999 with n = 2, which dwells at end expiration.
    Until ``held_until_s`` the breath is held there.
    """

    held_until_s: float
    frequency_hz: float = 0.25

    def depth(self, time_s: float) -> float:
        """Depth of breath at ``time_s``, 0 to 1."""
        since_s = max(time_s - self.held_until_s, 0.0)
        return float(np.sin(np.pi * self.frequency_hz * since_s) ** 4)

    def depths(self, times_s: FloatArray) -> FloatArray:
        """Depths of breath (n,) at ``times_s`` (n,)."""
        since_s = np.maximum(times_s - self.held_until_s, 0.0)
        # The power of an array has other rounding than that of a number.
        return np.array([sine**4 for sine in np.sin(np.pi * self.frequency_hz * since_s)])


@dataclass(frozen=True, slots=True, eq=False)
class BreathingBody:
    """A body that breathing moves: its rest pose, and its displacement at full inspiration.

    ``shift_mm`` (3,) is in the rest pose's target frame; ``turn_rad`` (3,) is a rotation vector
    about the body's own origin.
    """

    rest: Transform
    shift_mm: FloatArray
    turn_rad: FloatArray

    def at(self, depth: float) -> Transform:
        """The pose at a depth of breath of 0 to 1."""
        turn = rotation_of_vector(depth * self.turn_rad)
        return Transform.unchecked(
            self.rest.target,
            self.rest.source,
            self.rest.rotation @ turn,
            self.rest.translation_mm + depth * self.shift_mm,
        )

    def at_all(self, depths: FloatArray) -> Poses:
        """The poses at n depths of breath (n,)."""
        turns = np.array([rotation_of_vector(turn) for turn in depths[:, None] * self.turn_rad])
        return Poses(
            self.rest.target,
            self.rest.source,
            np.matmul(self.rest.rotation, turns),
            self.rest.translation_mm + depths[:, None] * self.shift_mm,
        )


class TouchArm:
    """The kinematics of ``data/robots/touch``, in `BASE_FRAME`.

    The tool's tip is the origin of `TOOL_LINK`, and the tool points along its +z.
    """

    def __init__(self) -> None:
        self._robot = load_robot(TOUCH_URDF)

    @property
    def joint_names(self) -> Sequence[str]:
        """Names of the joints, in the order of the joint states."""
        return self._robot.actuated_joint_names

    def base_from_tool(self, joints: Mapping[str, float]) -> Transform:
        """Pose of the tip in the base frame for ``joints`` (rad)."""
        root_from_tip = self._robot.forward_kinematics(joints)[TOOL_LINK]
        return root_from_tip.renamed(target=BASE_FRAME, source=TIP_FRAME)

    def joints_for(
        self, base_from_tool: Transform, seed: Mapping[str, float] | None
    ) -> Mapping[str, float]:
        """Joints (rad) near ``seed`` that reach the pose; raises `UnreachableError` if none do."""
        root_from_tip = base_from_tool.renamed(target=self._robot.root_link, source=TOOL_LINK)
        return self._robot.inverse_kinematics(TOOL_LINK, root_from_tip, seed=seed)
