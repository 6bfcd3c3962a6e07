"""The simulated operating room: true poses at any time.

Assumptions:

- The robot's base and the tracker are fixed in the room.
- The chest reference breathes a little (1.2 mm), the tumour and its sensor more (4.4 mm). The
  landmarks are touched in a breath-hold at end expiration, as ventilated patients are registered.
  The base's pose in the reference at end expiration is the truth of the registration; at full
  inspiration it is off by the motion of the reference.
- The tumour's sensor is rigidly attached to the tumour, and the tool does not deform the tumour.
- The arm has its own clock. What is measured of all this, and with which errors, is the matter of
  `app.synthetic.recording`.
"""

from dataclasses import dataclass

import numpy as np

from app.geometry import NS_PER_S, FloatArray, Transform
from app.synthetic.case_options import CaseOptions, contoured
from app.synthetic.error_budget import margin_bound_mm, plan_depths
from app.synthetic.motion import Breathing, BreathingBody, JointMotion, Poses, TouchArm
from app.synthetic.scenario import WORK_FRAME, Scenario, plan_scenario
from app.synthetic.truth import Clearance
from app.synthetic.tumour_and_tool import (
    BASE_FRAME,
    TIP_FRAME,
    TOOL_SENSOR,
    TUMOR_FRAME,
    TUMOR_SENSOR,
    Tumour,
    tool_mesh,
)

TRACKED_FRAMES = ("reference", TUMOR_SENSOR, TOOL_SENSOR)

FIRST_STAMP_NS = 1000 * NS_PER_S
KNOT_PERIOD_NS = 20_000_000
"""The arm's set points; a case lasts a whole number of these periods."""
JOINT_PERIOD_NS = 5_000_000
ROBOT_TO_TRACKER_OFFSET_NS = 37_400_000
"""tracker = robot + offset."""

HANDLE_END_MM = 130.0
"""Where the arm holds the tool, behind its tip."""

WORK_IN_BASE_MM = (185.0, 0.0, 90.0)
"""The tumour's centre. An arm with links of 133 mm reaches every pose of the scenario there, with
the tool's tip at the tip of its last link or 70 mm (an instrument's length) ahead."""

REFERENCE_IN_BASE_MM = (245.0, 120.0, 105.0)

TISSUE_SHIFT_MM = (0.0, 2.6, 3.6)
TISSUE_TURN_RAD = (0.015, 0.006, 0.0)
CHEST_SHIFT_MM = (0.0, 0.4, 1.15)
CHEST_TURN_RAD = (0.004, 0.0, 0.002)
"""Motion at full inspiration, in the axes of the base (z up): tissue 4.4 mm, chest 1.2 mm."""

TOOL_FROM_TIP = Transform.from_rotation_vector(
    (0.5, -0.3, 1.1), (7.0, -3.0, 70.0), target=TOOL_SENSOR, source=TIP_FRAME
)
_TIP_FROM_TOOL = TOOL_FROM_TIP.inverse()
_POSES_OF_TOOL = Poses.of([_TIP_FROM_TOOL])
SENSOR_FROM_TUMOR = Transform.from_rotation_vector(
    (-0.4, 0.7, 0.2), (5.0, -4.0, 31.0), target=TUMOR_SENSOR, source=TUMOR_FRAME
)
_SENSOR_FROM_TUMOR = Poses.of([SENSOR_FROM_TUMOR])


@dataclass(frozen=True, slots=True, eq=False)
class Simulation:
    """A simulated case: true poses; times are in s from the first acquisition.

    ``contour`` is the tumour as the case knows it. ``margin_bound_mm`` bounds the error of a
    measured margin.
    """

    tumour: Tumour
    contour: Tumour
    margin_bound_mm: float
    clearance: Clearance
    scenario: Scenario
    breathing: Breathing
    reference: BreathingBody
    tumor_sensor: BreathingBody
    tracker_from_base: Transform
    arm_motion: JointMotion

    @property
    def duration_s(self) -> float:
        """From the first to the last acquisition: a multiple of 20 ms."""
        period_s = KNOT_PERIOD_NS / NS_PER_S
        return int(self.scenario.path.end_s / period_s) * period_s

    @property
    def reference_from_base(self) -> Transform:
        """The truth of the registration, at end expiration."""
        return self.reference.at(0.0).inverse() @ self.tracker_from_base

    def tracker_from(self, frame: str, time_s: float) -> Transform:
        """The true pose of a tracked frame."""
        if frame == TOOL_SENSOR:
            return self.tracker_from_base @ self.base_from_tip(time_s) @ _TIP_FROM_TOOL
        body = self.reference if frame == "reference" else self.tumor_sensor
        return body.at(self.breathing.depth(time_s))

    def base_from_tip(self, time_s: float) -> Transform:
        """The true pose of the tool's tip in the robot's base."""
        return self.arm_motion.base_from_tool(time_s)

    def tumor_from_tip(self, time_s: float) -> Transform:
        """The true pose of the tool in the tumour."""
        tracker_from_tumor = self.tracker_from(TUMOR_SENSOR, time_s) @ SENSOR_FROM_TUMOR
        return tracker_from_tumor.inverse() @ self.tracker_from_base @ self.base_from_tip(time_s)

    def landmarks_in_base_mm(self) -> FloatArray:
        """The true places (n, 3) of the tip in the dwells of the registration."""
        middles = [0.5 * (start_s + end_s) for start_s, end_s in self.scenario.dwells_s]
        return np.array([self.base_from_tip(time_s).translation_mm for time_s in middles])

    def tumor_from_tips(self, times_s: FloatArray) -> Poses:
        """The true poses of the tool in the tumour at ``times_s`` (n,)."""
        sensor = self.tumor_sensor.at_all(self.breathing.depths(times_s))
        tumor_from_tracker = (sensor @ _SENSOR_FROM_TUMOR).inverse()
        base_from_tip = self.arm_motion.base_from_tools(times_s)
        return tumor_from_tracker @ Poses.of([self.tracker_from_base]) @ base_from_tip

    def tracked(self, times_s: FloatArray) -> tuple[tuple[Poses, ...], FloatArray]:
        """The true poses of `TRACKED_FRAMES` in the tracker at ``times_s`` (n,).

        Also the ends (n, 2, 3) of the arm, from its base to the end of the tool's handle, in mm in
        the tracker: metal, which distorts its field.
        """
        depths = self.breathing.depths(times_s)
        base_from_tip = self.arm_motion.base_from_tools(times_s)
        tracker_from_base = Poses.of([self.tracker_from_base])
        tool = tracker_from_base @ base_from_tip @ _POSES_OF_TOOL
        ends = np.zeros((len(times_s), 2, 3))
        ends[:, 1] = base_from_tip.apply(np.array([[0.0, 0.0, -HANDLE_END_MM]]))[:, 0]
        bodies = (self.reference.at_all(depths), self.tumor_sensor.at_all(depths))
        return (*bodies, tool), self.tracker_from_base.apply(ends)


def simulate(
    arm: TouchArm,
    random: np.random.Generator,
    options: CaseOptions | None = None,
    *,
    contour_random: np.random.Generator | None = None,
) -> Simulation:
    """Simulate a case with a random tumour, tracker and chest reference.

    ``contour_random`` draws the error of the contour, the motion beyond the usual duration, and
    what depends on the surgeon's skill.
    Raises the arm's error for a pose that it cannot reach, and `InputError` for errors in
    ``options`` that hide a breach.
    """
    options = CaseOptions() if options is None else options
    more_random = np.random.default_rng(0) if contour_random is None else contour_random
    patient = options.patient
    tumour = patient.shaped(Tumour.generate(random))
    if options.tumor_mm is not None:
        tumour = tumour.with_diameter(options.tumor_mm)
    contour, contour_mm = contoured(tumour, options.errors.contour_mm, more_random)
    sensor_lever_mm = float(np.linalg.norm(SENSOR_FROM_TUMOR.translation_mm))
    bound_mm = margin_bound_mm(options, contour_mm, sensor_lever_mm + tumour.max_radius_mm)
    depths = plan_depths(bound_mm, tumour.min_radius_mm)
    clearance = Clearance(tumour, tool_mesh())
    turn = random.normal(size=3)
    turn *= random.uniform(0.3, 1.2) / np.linalg.norm(turn)
    tracker_from_base = Transform.from_rotation_vector(
        turn, random.uniform(-250.0, 250.0, size=3), target="tracker", source=BASE_FRAME
    )
    base_from_work = Transform(
        BASE_FRAME, WORK_FRAME, np.eye(3), WORK_IN_BASE_MM + patient.place_mm
    )
    tumor_from_work = Transform.from_rotation_vector(
        random.uniform(-0.5, 0.5, size=3), np.zeros(3), target=TUMOR_FRAME, source=WORK_FRAME
    )
    tracker_from_tumor = tracker_from_base @ base_from_work @ tumor_from_work.inverse()
    tumor_sensor = BreathingBody(
        tracker_from_tumor @ SENSOR_FROM_TUMOR.inverse(),
        patient.breath_scale * tracker_from_base.rotate(TISSUE_SHIFT_MM),
        patient.breath_scale * np.array(TISSUE_TURN_RAD),
    )
    base_from_reference = Transform.from_rotation_vector(
        random.uniform(-0.6, 0.6, size=3),
        REFERENCE_IN_BASE_MM,
        target=BASE_FRAME,
        source="reference",
    )
    reference = BreathingBody(
        tracker_from_base @ base_from_reference,
        patient.breath_scale * tracker_from_base.rotate(CHEST_SHIFT_MM),
        patient.breath_scale * np.array(CHEST_TURN_RAD),
    )
    scenario = plan_scenario(
        tumour,
        clearance,
        tumor_from_work,
        depths,
        options.duration_s,
        more_random,
        options.surgeon,
    )
    breathing = Breathing(scenario.breath_held_until_s, patient.breath_hz)

    base_from_tracker = tracker_from_base.inverse()

    def planned(time_s: float, tumor_from_tip: Transform) -> Transform:
        tracker_from_sensor = tumor_sensor.at(breathing.depth(time_s))
        return base_from_tracker @ tracker_from_sensor @ SENSOR_FROM_TUMOR @ tumor_from_tip

    period_s = KNOT_PERIOD_NS / NS_PER_S
    count = int(np.ceil(scenario.path.end_s / period_s)) + 1
    knots: FloatArray = period_s * np.arange(count, dtype=np.float64)
    return Simulation(
        tumour,
        contour,
        bound_mm,
        clearance,
        scenario,
        breathing,
        reference,
        tumor_sensor,
        tracker_from_base,
        JointMotion(arm, knots, list(map(planned, knots.tolist(), scenario.path.poses(knots)))),
    )
