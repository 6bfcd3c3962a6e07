"""Commands to an arm, and whether it follows them."""

import math
from dataclasses import dataclass
from enum import StrEnum

from app.simulation.errors import CommandError

COMMAND_LIFETIME_NS = 30_000_000
"""An arm stops when its last command is older."""


class ArmStatus(StrEnum):
    """ENABLED: follows a fresh command. PAUSED: stands without one. FAULT: stands until enabled."""

    ENABLED = "ENABLED"
    PAUSED = "PAUSED"
    FAULT = "FAULT"


@dataclass(frozen=True, slots=True)
class JointVelocityCommand:
    """Velocities of all actuated joints, in their order, in rad/s (m/s for sliding joints).

    ``stamp_ns`` is the time of the command on the clock of the simulation.
    """

    stamp_ns: int
    joints: tuple[str, ...]
    velocities: tuple[float, ...]


class CommandGate:
    """Decides which velocities the arm ``name`` with ``joints`` follows at a time."""

    def __init__(self, name: str, joints: tuple[str, ...]) -> None:
        self._name, self._joints = name, joints
        self._command: JointVelocityCommand | None = None
        self.fault = ""
        """Why the arm is in FAULT; empty if it is not."""

    def accept(self, command: JointVelocityCommand, now_ns: int) -> None:
        """Follow ``command`` from now on; the latest by stamp remains.

        Raises `CommandError`, and puts the arm into FAULT, for other joints or another order, for a
        velocity that is not finite and for a stamp after ``now_ns``. An arm in FAULT accepts none.
        """
        problem = self._problem(command, now_ns)
        if problem:
            self.fault, self._command = problem, None
            raise CommandError(f"servo_jv of arm {self._name!r}: {problem}")
        if not self.fault and (self._command is None or command.stamp_ns >= self._command.stamp_ns):
            self._command = command

    def fail(self, reason: str) -> None:
        """Put the arm into FAULT."""
        self.fault, self._command = reason, None

    def enable(self) -> None:
        """Leave FAULT; the arm stands until the next command."""
        self.fault, self._command = "", None

    def velocities(self, now_ns: int) -> tuple[ArmStatus, tuple[float, ...]]:
        """The status, and the velocities to follow: 0 unless ENABLED."""
        still = (0.0,) * len(self._joints)
        if self.fault:
            return ArmStatus.FAULT, still
        if self._command is None or now_ns - self._command.stamp_ns > COMMAND_LIFETIME_NS:
            return ArmStatus.PAUSED, still
        return ArmStatus.ENABLED, self._command.velocities

    def _problem(self, command: JointVelocityCommand, now_ns: int) -> str:
        if command.joints != self._joints:
            return (
                f"joints are {', '.join(command.joints) or 'none'}; "
                f"expected {', '.join(self._joints)} in this order"
            )
        if len(command.velocities) != len(self._joints):
            return f"{len(command.velocities)} velocities; expected {len(self._joints)}"
        for joint, velocity in zip(command.joints, command.velocities, strict=True):
            if not math.isfinite(velocity):
                return f"velocity of joint {joint!r} is {velocity}; expected a finite number"
        if command.stamp_ns > now_ns:
            return f"stamp is {command.stamp_ns - now_ns} ns in the future; expected the past"
        return ""
