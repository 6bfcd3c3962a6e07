"""The simulated operating room: true poses at any time, and the samples of the tracker.

Assumptions:

- The robot's base and the tracker are fixed in the room.
- The chest reference breathes a little (1.2 mm), the tumour and its needle more (4.4 mm). The
  landmarks are touched in a breath-hold at end expiration, as ventilated patients are registered.
  The base's pose in the reference at end expiration is the truth of the registration; at full
  inspiration it is off by the motion of the reference.
- The needle's sensor is rigidly attached to the tumour, and the tool does not deform the tumour.
- The arm's encoders are exact and have their own clock. The tracker has white jitter and dropouts
  but no field distortion.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from app.case.frames.samples import JointSample, TrackingFrame
from app.geometry import NS_PER_S, FloatArray, Stamp, TrackedTransform, TrackingStatus, Transform
from app.synthetic.cautery import CAUTERY_TIP_FRAME, cautery_mesh
from app.synthetic.clearance import Clearance
from app.synthetic.motion import ArmKinematics, JointMotion
from app.synthetic.physiology import Breathing, BreathingBody
from app.synthetic.scenario import WORK_FRAME, Scenario, plan_scenario
from app.synthetic.tracker import Jitter, reported
from app.synthetic.tumour import TUMOR_FRAME, Tumour

TRACKED_FRAMES = ("reference", "needle", "cautery")
BASE_FRAME = "robot_base"

FIRST_STAMP_NS = 1000 * NS_PER_S
TRACKER_PERIOD_NS = 20_000_000
JOINT_PERIOD_NS = 5_000_000
ROBOT_TO_TRACKER_OFFSET_NS = 37_400_000
"""tracker = robot + offset."""

WORK_IN_BASE_MM = (185.0, 0.0, 90.0)
"""The tumour's centre. An arm with links of 133 mm reaches every pose of the scenario there, with
the tool's tip at the tip of its stylus or 70 mm (an instrument's length) ahead."""

REFERENCE_IN_BASE_MM = (245.0, 120.0, 105.0)

TISSUE_SHIFT_MM = (0.0, 2.6, 3.6)
TISSUE_TURN_RAD = (0.015, 0.006, 0.0)
CHEST_SHIFT_MM = (0.0, 0.4, 1.15)
CHEST_TURN_RAD = (0.004, 0.0, 0.002)
"""Motion at full inspiration, in the axes of the base (z up): tissue 4.4 mm, chest 1.2 mm."""

CAUTERY_FROM_TIP = Transform.from_rotation_vector(
    (0.5, -0.3, 1.1), (7.0, -3.0, 70.0), target="cautery", source=CAUTERY_TIP_FRAME
)
NEEDLE_FROM_TUMOR = Transform.from_rotation_vector(
    (-0.4, 0.7, 0.2), (5.0, -4.0, 31.0), target="needle", source=TUMOR_FRAME
)


@dataclass(frozen=True, slots=True, eq=False)
class Simulation:
    """A simulated case: true poses and noisy frames; times are in s from the first frame."""

    tumour: Tumour
    clearance: Clearance
    scenario: Scenario
    breathing: Breathing
    reference: BreathingBody
    needle: BreathingBody
    tracker_from_base: Transform
    arm_motion: JointMotion

    @property
    def duration_s(self) -> float:
        """Time from the first to the last tracker frame: a multiple of the period."""
        period_s = TRACKER_PERIOD_NS / NS_PER_S
        return int(self.scenario.path.end_s / period_s) * period_s

    @property
    def reference_from_base(self) -> Transform:
        """The truth of the registration, at end expiration."""
        return self.reference.at(0.0).inverse() @ self.tracker_from_base

    def tracker_from(self, frame: str, time_s: float) -> Transform:
        """The true pose of a tracked frame."""
        if frame == "cautery":
            tip_from_cautery = CAUTERY_FROM_TIP.inverse()
            return self.tracker_from_base @ self.base_from_tip(time_s) @ tip_from_cautery
        body = self.reference if frame == "reference" else self.needle
        return body.at(self.breathing.depth(time_s))

    def base_from_tip(self, time_s: float) -> Transform:
        """The true pose of the tool's tip in the robot's base."""
        return self.arm_motion.base_from_tool(time_s)

    def tumor_from_tip(self, time_s: float) -> Transform:
        """The true pose of the tool in the tumour."""
        tracker_from_tumor = self.tracker_from("needle", time_s) @ NEEDLE_FROM_TUMOR
        return tracker_from_tumor.inverse() @ self.tracker_from_base @ self.base_from_tip(time_s)

    def frames(self, jitter: Jitter, random: np.random.Generator) -> Iterator[TrackingFrame]:
        """Yield the recorded frames: at 50 Hz, each with the joints read since the last.

        A frame without any sample is left out, and its joints come with the next one.
        """
        joints: list[JointSample] = []
        joint_ns = self._first_joint_ns()
        for index in range(round(self.duration_s * NS_PER_S / TRACKER_PERIOD_NS) + 1):
            stamp = Stamp(FIRST_STAMP_NS + index * TRACKER_PERIOD_NS)
            while joint_ns + ROBOT_TO_TRACKER_OFFSET_NS <= stamp.ns:
                joints.append(self._joint_sample(joint_ns))
                joint_ns += JOINT_PERIOD_NS
            poses = self._measure(stamp, jitter, random)
            if poses:
                yield TrackingFrame(stamp, poses, tuple(joints))
                joints = []

    def _measure(
        self, stamp: Stamp, jitter: Jitter, random: np.random.Generator
    ) -> tuple[TrackedTransform, ...]:
        time_s = (stamp.ns - FIRST_STAMP_NS) / NS_PER_S
        arrived = []
        for frame in TRACKED_FRAMES:
            measured = jitter.measured(self.tracker_from(frame, time_s), random)
            sample = TrackedTransform(measured, stamp, TrackingStatus.OK)
            received = reported(sample, self.scenario.dropouts, time_s)
            if received is not None:
                arrived.append(received)
        return tuple(arrived)

    def _joint_sample(self, robot_ns: int) -> JointSample:
        time_s = (robot_ns + ROBOT_TO_TRACKER_OFFSET_NS - FIRST_STAMP_NS) / NS_PER_S
        return JointSample(
            self.arm_motion.joint_names,
            tuple(self.arm_motion.positions(time_s).tolist()),
            Stamp(robot_ns, "robot"),
        )

    def _first_joint_ns(self) -> int:
        """Stamp of the last joint sample before the first tracker frame, on the robot's clock."""
        first_ns = FIRST_STAMP_NS - ROBOT_TO_TRACKER_OFFSET_NS
        return first_ns // JOINT_PERIOD_NS * JOINT_PERIOD_NS


def simulate(arm: ArmKinematics, random: np.random.Generator) -> Simulation:
    """Simulate a case with a random tumour, tracker and chest reference.

    Raises the arm's error for a pose that it cannot reach.
    """
    tumour = Tumour.generate(random)
    clearance = Clearance(tumour, cautery_mesh())
    turn = random.normal(size=3)
    turn *= random.uniform(0.3, 1.2) / np.linalg.norm(turn)
    tracker_from_base = Transform.from_rotation_vector(
        turn, random.uniform(-250.0, 250.0, size=3), target="tracker", source=BASE_FRAME
    )
    base_from_work = Transform(BASE_FRAME, WORK_FRAME, np.eye(3), np.array(WORK_IN_BASE_MM))
    tumor_from_work = Transform.from_rotation_vector(
        random.uniform(-0.5, 0.5, size=3), np.zeros(3), target=TUMOR_FRAME, source=WORK_FRAME
    )
    tracker_from_tumor = tracker_from_base @ base_from_work @ tumor_from_work.inverse()
    needle = BreathingBody(
        tracker_from_tumor @ NEEDLE_FROM_TUMOR.inverse(),
        tracker_from_base.rotate(TISSUE_SHIFT_MM),
        np.array(TISSUE_TURN_RAD),
    )
    base_from_reference = Transform.from_rotation_vector(
        random.uniform(-0.6, 0.6, size=3),
        REFERENCE_IN_BASE_MM,
        target=BASE_FRAME,
        source="reference",
    )
    reference = BreathingBody(
        tracker_from_base @ base_from_reference,
        tracker_from_base.rotate(CHEST_SHIFT_MM),
        np.array(CHEST_TURN_RAD),
    )
    scenario = plan_scenario(tumour, clearance, tumor_from_work)
    breathing = Breathing(scenario.breath_held_until_s)

    base_from_tracker = tracker_from_base.inverse()

    def planned(time_s: float) -> Transform:
        tracker_from_needle = needle.at(breathing.depth(time_s))
        tumor_from_tip = scenario.path.at(time_s)
        return base_from_tracker @ tracker_from_needle @ NEEDLE_FROM_TUMOR @ tumor_from_tip

    period_s = TRACKER_PERIOD_NS / NS_PER_S
    count = int(np.ceil(scenario.path.end_s / period_s)) + 1
    knots: FloatArray = period_s * np.arange(count, dtype=np.float64)
    return Simulation(
        tumour,
        clearance,
        scenario,
        breathing,
        reference,
        needle,
        tracker_from_base,
        JointMotion(arm, knots, [planned(time_s) for time_s in knots.tolist()]),
    )
