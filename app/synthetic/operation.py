"""A simulated operation with tracked ultrasound that goes through its phases on request."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from app.geometry import FloatArray, InputError, Transform
from app.geometry.rotations import rotation_of_vector
from app.synthetic.motion import TouchArm
from app.synthetic.tumour_and_tool import (
    BASE_FRAME,
    TIP_FRAME,
    TOOL_SENSOR,
    TUMOR_FRAME,
    TUMOR_SENSOR,
    Tumour,
)

PROBE, REFERENCE, TRACKER = "probe", "reference", "tracker"
DIAMETER_MM = 18.0
SUPPOSED_RADIUS_MM = 5.0
"""Radius of the ball that stands for the tumour before it is contoured."""

_TIP_MM = (7.0, -3.0, 112.0)
_SHAFT = (0.10, 0.06, 1.0)
_TIP_ERROR_MM = 2.0
_BASE_ERROR_MM = 1.5
_BASE_CENTRE_MM = (185.2, -1.6, 100.7)
"""Place in the robot's base around which the arm reaches 50 mm to all sides."""
COLUMNS, ROWS = 200, 160
PIXEL_MM = 0.25
_TUMOUR_LEVEL, _TISSUE_LEVEL, _SPECKLE = 45.0, 130.0, 0.8
RATE_HZ = 40.0
IMAGE_STEPS = 4
"""Steps from one image to the next."""
PLANES = 9
"""Image planes over the tumour in which the probe can rest."""
_SPEED_MM_S, _SLOW_MM_S, _TURN_RAD_S = 80.0, 12.0, 1.0
_DWELL_S = 1.6
_CONE_RAD, _SETTLE_S = np.radians(32.0), 0.5
_NOISE_MM, _NOISE_RAD = 0.05, np.radians(0.03)
_APPROACH_MM, _BREACH_MM, _RETREAT_MM = 5.0, -3.0, 35.0
_LANDMARKS_MM = (
    (0, 35, -10), (-20, 30, 35), (-35, 0, 20), (-25, -25, -20), (0, -35, 30), (30, -20, -25),
    (35, 0, 10), (25, 25, 40),
)  # fmt: skip
"""From the tumour's centre, in an order whose straight ways stay outside of the tumour."""
_LINK = (
    (-0.98548, 0.01639, -0.16898),
    (-0.01906, 0.97837, 0.20601),
    (0.1687, 0.20624, -0.96385),
)
"""Rotation of the arm's last link in its base; only its origin touches the tip of the tool."""


@dataclass(frozen=True, slots=True, eq=False)
class OperationTruth:
    """The true tumour, calibrations and places; ``supposed_...`` is what the session begins with.

    ``centre_mm`` (3,) is the tumour's centre in the reference.
    """

    tumour: Tumour
    tool_from_tip: Transform
    supposed_tool_from_tip: Transform
    reference_from_base: Transform
    supposed_reference_from_base: Transform
    reference_from_sensor: Transform
    sensor_from_tumor: Transform

    @property
    def centre_mm(self) -> FloatArray:
        """Centre of the tumour in the reference."""
        return (self.reference_from_sensor @ self.sensor_from_tumor).translation_mm


def operation_truth(seed: int) -> OperationTruth:
    """The truth of ``seed``; the same seed gives the same."""
    random = np.random.default_rng([seed, 21])
    tumour = Tumour.generate(random).with_diameter(DIAMETER_MM)
    shaft = np.array(_SHAFT) / np.linalg.norm(_SHAFT)
    tip_mm = np.array(_TIP_MM)
    base = Transform(REFERENCE, BASE_FRAME, _turn(random, 0.5), random.uniform(-200.0, 200.0, 3))
    sensor = Transform(
        REFERENCE, TUMOR_SENSOR, _turn(random, 0.4), base.apply(np.array(_BASE_CENTRE_MM))
    )
    return OperationTruth(
        tumour=tumour,
        tool_from_tip=Transform(TOOL_SENSOR, TIP_FRAME, _onto(shaft), tip_mm),
        supposed_tool_from_tip=Transform(
            TOOL_SENSOR, TIP_FRAME, np.eye(3), tip_mm + _TIP_ERROR_MM * _direction(random)
        ),
        reference_from_base=base,
        supposed_reference_from_base=Transform(
            REFERENCE,
            BASE_FRAME,
            base.rotation,
            base.translation_mm + _BASE_ERROR_MM * _direction(random),
        ),
        reference_from_sensor=sensor,
        sensor_from_tumor=Transform(TUMOR_SENSOR, TUMOR_FRAME, _turn(random, 0.3), np.zeros(3)),
    )


def _turn(random: np.random.Generator, angle_rad: float) -> FloatArray:
    return rotation_of_vector(angle_rad * _direction(random))


def _direction(random: np.random.Generator) -> FloatArray:
    vector = random.normal(size=3)
    return np.asarray(vector / np.linalg.norm(vector))


def _onto(axis: FloatArray) -> FloatArray:
    """The rotation that turns +z onto the unit ``axis`` (3,), in the plane of both."""
    across = np.cross([0.0, 0.0, 1.0], axis)
    length = float(np.linalg.norm(across))
    return rotation_of_vector(across / length * np.arctan2(length, axis[2]))


def probe_from_image() -> FloatArray:
    """ImageToProbe (4, 4): pixels to mm, the middle of the image at the origin of the probe."""
    matrix = np.diag([PIXEL_MM, PIXEL_MM, PIXEL_MM, 1.0])
    matrix[:2, 3] = -PIXEL_MM * COLUMNS / 2, -PIXEL_MM * ROWS / 2
    return matrix


class UltrasoundSlice:
    """Images of ``tumour``, which is darker than the tissue around it. For one thread.

    The tissue is computed anew for another pose of the probe; the speckle differs in each image.
    """

    def __init__(self, tumour: Tumour, random: np.random.Generator) -> None:
        self._tumour, self._random = tumour, random
        row, column = np.mgrid[:ROWS, :COLUMNS]
        pixels = np.stack([column, row, np.zeros_like(row), np.ones_like(row)], axis=-1)
        self._probe_mm = (pixels.reshape(-1, 4) @ probe_from_image().T)[:, :3]
        self._pose: FloatArray | None = None
        self._level = np.zeros((ROWS, COLUMNS))

    def image(self, tumor_from_probe: Transform) -> NDArray[np.uint8]:
        """The image (rows, columns) at this pose."""
        matrix = tumor_from_probe.matrix
        if self._pose is None or not np.array_equal(matrix, self._pose):
            places_mm = tumor_from_probe.apply(self._probe_mm) + 1e-9  # no direction is zero
            radius_mm = np.linalg.norm(places_mm, axis=1)
            inside = radius_mm < self._tumour.radius_mm(places_mm / radius_mm[:, None])
            level = np.where(inside, _TUMOUR_LEVEL, _TISSUE_LEVEL)
            self._pose, self._level = matrix, level.reshape(ROWS, COLUMNS)
        speckle = self._random.rayleigh(_SPECKLE, size=self._level.shape)
        return np.clip(self._level * speckle, 0, 255).astype(np.uint8)


class Phase(StrEnum):
    """Phase of the operator's work."""

    REST = "rest"
    PIVOT = "pivot"
    SPIN = "spin"
    SWEEP = "sweep"
    TOUCH = "touch"
    APPROACH = "approach"
    BREACH = "breach"
    RETREAT = "retreat"


@dataclass(frozen=True, slots=True, eq=False)
class OperationMoment:
    """Measured poses in the tracker's frame, joints by name in rad, and every fourth an image."""

    poses: tuple[Transform, ...]
    joints: Mapping[str, float]
    image: NDArray[np.uint8] | None


class Operation:
    """Moves tool, probe and arm by steps of 1 / `RATE_HZ`; the same seed and requests, the same.

    ``reached(phase)`` is called once for each request, when its motion has come to its end, or
    for a pivot and a spin to its full extent. For one thread.
    """

    def __init__(
        self, truth: OperationTruth, arm: TouchArm, seed: int, reached: Callable[[str], None]
    ) -> None:
        self._truth, self._arm, self._reached = truth, arm, reached
        self._noise = np.random.default_rng([seed, 22])
        self._slices = UltrasoundSlice(truth.tumour, np.random.default_rng([seed, 23]))
        self._phase, self._is_reached, self._steps = Phase.REST, True, 0
        self._plane = PLANES // 2
        self._tip_mm = self._above(_RETREAT_MM)
        self._targets: list[FloatArray] = []
        self._dwell_s = self._cone_rad = self._roll_rad = self._seconds = 0.0
        self._joints: Mapping[str, float] | None = None
        # Of the sensor with the shaft along -z of the reference.
        self._base_rotation = np.diag([1.0, -1.0, -1.0]) @ truth.tool_from_tip.rotation.T

    def request(self, text: str) -> None:
        """Begin a phase: its name, for a sweep with the number of an image plane (``sweep 3``).

        Raises `InputError` for anything else.
        """
        name, _, number = text.strip().partition(" ")
        if name not in list(Phase) or (number and name != Phase.SWEEP):
            raise InputError(f"phase: {text.strip()[:40]!r}; expected one of {', '.join(Phase)}")
        if name == Phase.SWEEP:
            if not number.isdecimal() or int(number) >= PLANES:
                raise InputError(f"sweep: {number!r}; expected a plane from 0 to {PLANES - 1}")
            self._plane = int(number)
        self._phase, self._is_reached = Phase(name), False
        self._targets = {
            Phase.TOUCH: [self._truth.centre_mm + np.array(each) for each in _LANDMARKS_MM],
            Phase.APPROACH: [self._above(_APPROACH_MM)],
            Phase.BREACH: [self._above(_BREACH_MM)],
            Phase.RETREAT: [self._above(_APPROACH_MM), self._above(_RETREAT_MM)],
        }.get(self._phase, [self._above(_RETREAT_MM)])

    def step(self) -> OperationMoment:
        """The next moment."""
        step_s = 1.0 / RATE_HZ
        self._steps += 1
        self._move(step_s)
        rotation, truth = self._rotation(step_s), self._truth
        sensor_mm = self._tip_mm - rotation @ truth.tool_from_tip.translation_mm
        tool = Transform(REFERENCE, TOOL_SENSOR, rotation, sensor_mm)
        probe = self._probe()
        image = None
        if self._steps % IMAGE_STEPS == 0:
            tumor_from_reference = (truth.reference_from_sensor @ truth.sensor_from_tumor).inverse()
            image = self._slices.image(tumor_from_reference @ probe)
        poses = (Transform.identity(REFERENCE, REFERENCE), truth.reference_from_sensor, tool, probe)
        measured = [self._measured(pose) for pose in poses]
        return OperationMoment(tuple(measured), self._arm_joints(), image)

    def _move(self, step_s: float) -> None:
        """Move the tip along its targets, and report the end of the phase."""
        slow = self._phase in (Phase.APPROACH, Phase.BREACH)
        left_mm = (_SLOW_MM_S if slow else _SPEED_MM_S) * step_s
        if self._targets:
            away = self._targets[0] - self._tip_mm
            distance_mm = float(np.linalg.norm(away))
            if distance_mm > left_mm:
                self._tip_mm = self._tip_mm + away * (left_mm / distance_mm)
                return
            self._tip_mm, self._dwell_s = self._targets[0], self._dwell_s + step_s
            if self._phase is Phase.TOUCH and self._dwell_s < _DWELL_S:
                return
            del self._targets[0]
            self._dwell_s = 0.0
        if self._targets or self._is_reached or not self._is_turned():
            return
        self._is_reached = True
        self._reached(f"{self._phase} {self._plane}" if self._phase is Phase.SWEEP else self._phase)

    def _is_turned(self) -> bool:
        if self._phase is Phase.PIVOT:
            return bool(_CONE_RAD - self._cone_rad < np.radians(0.5))
        if self._phase is Phase.SPIN:
            return bool(self._cone_rad < np.radians(0.02))
        return bool(self._cone_rad < np.radians(0.2))

    def _rotation(self, step_s: float) -> FloatArray:
        """Rotation of the tool's sensor in the reference after another ``step_s``."""
        goal = _CONE_RAD if self._phase is Phase.PIVOT else 0.0
        self._seconds += step_s
        self._cone_rad += (goal - self._cone_rad) * step_s / _SETTLE_S
        if self._phase is Phase.SPIN and self._is_turned():
            self._roll_rad += 2.0 * np.pi * step_s / 8.0
        azimuth = 2.0 * np.pi * self._seconds / 3.0
        tilt = self._cone_rad * (0.6 + 0.4 * np.sin(2.0 * np.pi * self._seconds / 7.0))
        tilted = Rotation.from_rotvec(tilt * np.array([np.cos(azimuth), np.sin(azimuth), 0.0]))
        shaft = self._truth.tool_from_tip.rotation[:, 2]
        roll = Rotation.from_rotvec(self._roll_rad * shaft)
        down = Rotation.from_matrix(self._base_rotation)
        return np.asarray((tilted * down * roll).as_matrix())

    def _probe(self) -> Transform:
        """The probe in the reference, in its plane over the tumour."""
        u, v = np.array([0.8, 0.6, 0.0]), np.array([-0.36, 0.48, 0.8])
        normal = np.cross(u, v)
        offset_mm = 0.44 * DIAMETER_MM * (2.0 * self._plane / (PLANES - 1) - 1.0)
        place_mm = self._truth.centre_mm + offset_mm * normal
        return Transform(REFERENCE, PROBE, np.column_stack([u, v, normal]), place_mm)

    def _above(self, distance_mm: float) -> FloatArray:
        """A place at this distance above the top of the tumour, in the reference."""
        truth = self._truth
        up = np.array([0.0, 0.0, 1.0])
        rotation = (truth.reference_from_sensor @ truth.sensor_from_tumor).rotation
        radius_mm = float(truth.tumour.radius_mm((rotation.T @ up)[None])[0])
        return truth.centre_mm + (radius_mm + distance_mm) * up

    def _measured(self, pose: Transform) -> Transform:
        turn = Rotation.from_rotvec(self._noise.normal(0.0, _NOISE_RAD, 3)).as_matrix()
        shift_mm = self._noise.normal(0.0, _NOISE_MM, 3)
        return Transform(TRACKER, pose.source, pose.rotation @ turn, pose.translation_mm + shift_mm)

    def _arm_joints(self) -> Mapping[str, float]:
        """Joints with the tip of the arm at that of the tool; the arm does not follow a tilt."""
        place_mm = self._truth.reference_from_base.inverse().apply(self._tip_mm)
        rotation = Rotation.from_matrix(np.array(_LINK)).as_matrix()
        pose = Transform(BASE_FRAME, TIP_FRAME, rotation, place_mm)
        self._joints = self._arm.joints_for(pose, self._joints)
        return self._joints
