"""Commands to an arm, named for the topics of CRTK that carry them.

``stamp_ns`` is the time of the command on the clock of the simulation. Values are those of the
message; `CommandGate` checks them.
"""

from dataclasses import dataclass
from enum import StrEnum
from typing import ClassVar


class ArmStatus(StrEnum):
    """CRTK's operating states.

    ENABLED: follows a fresh command, and stands without one. PAUSED: stands until resumed.
    DISABLED and FAULT: stands until enabled.
    """

    DISABLED = "DISABLED"
    ENABLED = "ENABLED"
    PAUSED = "PAUSED"
    FAULT = "FAULT"


class StateCommand(StrEnum):
    """CRTK's state commands. An arm is homed from the start and stays so."""

    ENABLE = "enable"
    DISABLE = "disable"
    PAUSE = "pause"
    RESUME = "resume"
    HOME = "home"


@dataclass(frozen=True, slots=True)
class JointVelocityCommand:
    """Velocities of all actuated joints, in their order, in rad/s (m/s for sliding joints)."""

    topic: ClassVar[str] = "servo_jv"
    stamp_ns: int
    joints: tuple[str, ...]
    velocities: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class JointPositionCommand:
    """Positions of all actuated joints, in their order, in rad (m for sliding joints)."""

    topic: ClassVar[str] = "servo_jp"
    stamp_ns: int
    joints: tuple[str, ...]
    positions: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class ToolPoseCommand:
    """The tool's pose in ``frame``, the arm's root link: mm, and a unit quaternion x, y, z, w."""

    topic: ClassVar[str] = "servo_cp"
    stamp_ns: int
    frame: str
    position_mm: tuple[float, float, float]
    quaternion: tuple[float, float, float, float]


@dataclass(frozen=True, slots=True)
class ToolTwistCommand:
    """Velocity of the tool's origin and angular velocity, along the axes of the root link."""

    topic: ClassVar[str] = "servo_cv"
    stamp_ns: int
    frame: str
    linear_mm_s: tuple[float, float, float]
    angular_rad_s: tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class ToolWrenchCommand:
    """A wrench that the drives exert at the tool's origin; the weight of the arm is balanced.

    ``frame`` gives the axes: the root link (``servo_cf``), or the tool (``body/servo_cf``,
    ``in_tool``).
    """

    topic: ClassVar[str] = "servo_cf"
    stamp_ns: int
    frame: str
    force_n: tuple[float, float, float]
    torque_n_m: tuple[float, float, float]
    in_tool: bool = False


JointCommand = JointVelocityCommand | JointPositionCommand
ToolCommand = ToolPoseCommand | ToolTwistCommand | ToolWrenchCommand
ArmCommand = JointCommand | ToolCommand
