"""Truth of a simulated operation with ultrasound, and the supposed values of its configuration."""

from dataclasses import dataclass

import numpy as np

from app.geometry import FloatArray, Transform
from app.geometry.rotations import rotation_of_vector
from app.synthetic.cautery import CAUTERY_TIP_FRAME
from app.synthetic.simulation import BASE_FRAME
from app.synthetic.tumour import TUMOR_FRAME, Tumour

TOOL, NEEDLE, PROBE, REFERENCE, TRACKER = "cautery", "needle", "probe", "reference", "tracker"
DIAMETER_MM = 18.0
SUPPOSED_RADIUS_MM = 5.0
"""Radius of the ball that stands for the tumour before it is contoured."""

_TIP_MM = (7.0, -3.0, 112.0)
_SHAFT = (0.10, 0.06, 1.0)
_TIP_ERROR_MM = 2.0
_BASE_ERROR_MM = 1.5
_BASE_CENTRE_MM = (185.2, -1.6, 100.7)
"""Place in the robot's base around which the arm reaches 50 mm to all sides."""


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
    reference_from_needle: Transform
    needle_from_tumor: Transform

    @property
    def centre_mm(self) -> FloatArray:
        """Centre of the tumour in the reference."""
        return (self.reference_from_needle @ self.needle_from_tumor).translation_mm


def operation_truth(seed: int) -> OperationTruth:
    """The truth of ``seed``; the same seed gives the same."""
    random = np.random.default_rng([seed, 21])
    tumour = Tumour.generate(random).with_diameter(DIAMETER_MM)
    shaft = np.array(_SHAFT) / np.linalg.norm(_SHAFT)
    tip_mm = np.array(_TIP_MM)
    base = Transform(REFERENCE, BASE_FRAME, _turn(random, 0.5), random.uniform(-200.0, 200.0, 3))
    needle = Transform(REFERENCE, NEEDLE, _turn(random, 0.4), base.apply(np.array(_BASE_CENTRE_MM)))
    return OperationTruth(
        tumour=tumour,
        tool_from_tip=Transform(TOOL, CAUTERY_TIP_FRAME, _onto(shaft), tip_mm),
        supposed_tool_from_tip=Transform(
            TOOL, CAUTERY_TIP_FRAME, np.eye(3), tip_mm + _TIP_ERROR_MM * _direction(random)
        ),
        reference_from_base=base,
        supposed_reference_from_base=Transform(
            REFERENCE,
            BASE_FRAME,
            base.rotation,
            base.translation_mm + _BASE_ERROR_MM * _direction(random),
        ),
        reference_from_needle=needle,
        needle_from_tumor=Transform(NEEDLE, TUMOR_FRAME, _turn(random, 0.3), np.zeros(3)),
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
