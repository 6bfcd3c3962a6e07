"""Commands to an arm, and selection of one: none that is invalid, too old or not in its state.

Commands are named for the topics of CRTK that carry them. ``stamp_ns`` is the time of the command
on the clock of the simulation. Values are those of the message; `CommandGate` checks them.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import ClassVar

from app.simulation.errors import CommandError

COMMAND_LIFETIME_NS = 30_000_000
"""An arm stops when its last command is older."""
MAX_NORM_ERROR = 1e-3
"""Largest difference of a quaternion's norm from 1."""


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


class CommandGate:
    """Decides which command the arm ``name`` with ``joints`` follows at a time.

    ``root`` is its root link, ``tool`` the name of its tool, None where it holds none.
    """

    def __init__(self, name: str, joints: tuple[str, ...], root: str, tool: str | None) -> None:
        self._name, self._joints, self._root, self._tool = name, joints, root, tool
        self._command: ArmCommand | None = None
        self.status = ArmStatus.ENABLED
        self.fault = ""
        """The reason why the arm is in FAULT; empty if it is not."""

    def accept(self, command: ArmCommand, now_ns: int) -> None:
        """Follow ``command`` from now on; the latest by stamp remains.

        Raises `CommandError`, and puts the arm into FAULT, for other joints, another order or
        another frame, for a value that is not finite and for a stamp after ``now_ns``. An arm that
        is not ENABLED follows none.
        """
        problem = self._problem(command, now_ns)
        if problem:
            self.fail(problem)
            raise CommandError(f"{command.topic} of arm {self._name!r}: {problem}")
        is_newer = self._command is None or command.stamp_ns >= self._command.stamp_ns
        if self.status is ArmStatus.ENABLED and is_newer:
            self._command = command

    def fail(self, reason: str) -> None:
        """Put the arm into FAULT."""
        self.status, self.fault, self._command = ArmStatus.FAULT, reason, None

    def enable(self) -> None:
        """Leave FAULT, PAUSED and DISABLED; the arm stands until the next command."""
        self.status, self.fault, self._command = ArmStatus.ENABLED, "", None

    def request(self, command: StateCommand) -> None:
        """Change the state as CRTK does. Raises `CommandError` where the state does not allow it.

        ``enable`` ends FAULT and DISABLED, ``resume`` PAUSED alone.
        """
        allowed = {
            StateCommand.ENABLE: set(ArmStatus) - {ArmStatus.PAUSED},
            StateCommand.DISABLE: set(ArmStatus),
            StateCommand.PAUSE: {ArmStatus.ENABLED, ArmStatus.PAUSED},
            StateCommand.RESUME: {ArmStatus.ENABLED, ArmStatus.PAUSED},
            StateCommand.HOME: {ArmStatus.ENABLED, ArmStatus.PAUSED},
        }[command]
        if self.status not in allowed:
            raise CommandError(
                f"state_command of arm {self._name!r} is {str(command)!r} in state {self.status}; "
                f"expected the state {' or '.join(sorted(allowed))}"
            )
        if command is StateCommand.ENABLE and self.status is not ArmStatus.ENABLED:
            self.enable()
        elif command is StateCommand.DISABLE:
            self.status, self.fault, self._command = ArmStatus.DISABLED, "", None
        elif command is StateCommand.PAUSE:
            self.status, self._command = ArmStatus.PAUSED, None
        elif command is StateCommand.RESUME and self.status is ArmStatus.PAUSED:
            self.enable()

    def command(self, now_ns: int) -> ArmCommand | None:
        """The command to follow; None if the arm stands."""
        if self._command is None or now_ns - self._command.stamp_ns > COMMAND_LIFETIME_NS:
            return None
        return self._command

    def _problem(self, command: ArmCommand, now_ns: int) -> str:
        if isinstance(command, JointVelocityCommand | JointPositionCommand):
            problem = self._joints_problem(command)
        else:
            problem = self._frame_problem(command)
        if problem:
            return problem
        for what, value in _values(command):
            if not math.isfinite(value):
                return f"{what} is {value}; expected a finite number"
        if isinstance(command, ToolPoseCommand):
            norm = math.hypot(*command.quaternion)
            if abs(norm - 1.0) > MAX_NORM_ERROR:
                return f"norm of the quaternion is {norm:.4g}; expected 1"
        if command.stamp_ns > now_ns:
            return f"stamp is {command.stamp_ns - now_ns} ns in the future; expected the past"
        return ""

    def _joints_problem(self, command: JointVelocityCommand | JointPositionCommand) -> str:
        if command.joints != self._joints:
            return (
                f"joints are {', '.join(command.joints) or 'none'}; "
                f"expected {', '.join(self._joints)} in this order"
            )
        if isinstance(command, JointVelocityCommand):
            what, count = "velocities", len(command.velocities)
        else:
            what, count = "positions", len(command.positions)
        if count != len(self._joints):
            return f"{count} {what}; expected {len(self._joints)}"
        return ""

    def _frame_problem(
        self, command: ToolPoseCommand | ToolTwistCommand | ToolWrenchCommand
    ) -> str:
        if self._tool is None:
            return "the arm holds no tool; expected servo_jv or servo_jp"
        in_tool = isinstance(command, ToolWrenchCommand) and command.in_tool
        expected = self._tool if in_tool else self._root
        if command.frame != expected:
            return f"frame_id is {command.frame!r}; expected {expected!r}"
        return ""


def _values(command: ArmCommand) -> Iterator[tuple[str, float]]:
    """Yield each value of ``command`` that must be finite, with its name."""
    match command:
        case JointVelocityCommand():
            yield from _named("velocity of joint", command.joints, command.velocities)
        case JointPositionCommand():
            yield from _named("position of joint", command.joints, command.positions)
        case ToolPoseCommand():
            yield from _named("position", "xyz", command.position_mm)
            yield from _named("orientation", "xyzw", command.quaternion)
        case ToolTwistCommand():
            yield from _named("linear velocity", "xyz", command.linear_mm_s)
            yield from _named("angular velocity", "xyz", command.angular_rad_s)
        case ToolWrenchCommand():
            yield from _named("force", "xyz", command.force_n)
            yield from _named("torque", "xyz", command.torque_n_m)


def _named(what: str, names: Sequence[str], values: Sequence[float]) -> Iterator[tuple[str, float]]:
    for name, value in zip(names, values, strict=True):
        yield f"{what} {name!r}", value
