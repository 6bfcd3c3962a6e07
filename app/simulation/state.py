"""The true state of a world at one time: values that later steps do not change."""

from collections.abc import Mapping
from dataclasses import dataclass

from app.geometry import FloatArray, Transform
from app.robot.kinematic_tree import LinkPoses
from app.simulation.commands import ArmCommand, ArmStatus


@dataclass(frozen=True, slots=True, eq=False)
class ArmState:
    """Actuated joints (n,) in the order of the robot's file, in rad, rad/s, N m (m, m/s, N).

    ``setpoints`` are the velocities that the drives follow; 0 while they exert a wrench.
    ``command`` is the one that the arm follows, None while it stands.
    ``links`` has the pose of each link in the world, without links that have no body of their own.
    ``fault``: why the status is FAULT.
    """

    joints: tuple[str, ...]
    positions: FloatArray
    velocities: FloatArray
    efforts: FloatArray
    setpoints: FloatArray
    status: ArmStatus
    fault: str
    links: LinkPoses
    command: ArmCommand | None = None

    @property
    def is_busy(self) -> bool:
        """True while the arm follows a command."""
        return self.command is not None


@dataclass(frozen=True, slots=True, eq=False)
class WorldState:
    """Arms by name, and ``bodies``: poses in the world of tools, bodies and tissues by name."""

    time_ns: int
    arms: Mapping[str, ArmState]
    bodies: Mapping[str, Transform]


@dataclass(frozen=True, slots=True, eq=False)
class Contact:
    """Two bodies that overlap by ``depth_mm`` (negative: a gap) at ``point_mm`` (3,)."""

    bodies: tuple[str, str]
    depth_mm: float
    point_mm: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Wrench:
    """Force (3,) in N at the origin of a body and torque (3,) in N m, in the world's axes."""

    force_n: FloatArray
    torque_n_m: FloatArray
