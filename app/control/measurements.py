"""Measurements of a controller, each with its time in ns on one clock."""

from dataclasses import dataclass

from app.geometry import FloatArray, Transform


@dataclass(frozen=True, slots=True, eq=False)
class JointMeasurement:
    """Positions of joints by name, in rad, m for sliding joints (CRTK's ``measured_js``)."""

    stamp_ns: int
    names: tuple[str, ...]
    positions: tuple[float, ...]


@dataclass(frozen=True, slots=True, eq=False)
class WrenchMeasurement:
    """The hand's force (3,) in N at the tool's tip and its torque (3,) in N m about the tip.

    In the axes of the tool if ``in_tool`` (CRTK's ``body/measured_cf``), else of the robot's base.
    """

    stamp_ns: int
    force_n: FloatArray
    torque_n_m: FloatArray
    in_tool: bool = True


@dataclass(frozen=True, slots=True, eq=False)
class PoseMeasurement:
    """``rule_from_base``: the robot's base in the frame of the constraint."""

    stamp_ns: int
    rule_from_base: Transform
