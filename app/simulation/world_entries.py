"""The values of ``world.yaml``, in mm, rad, kg, N and integer ns."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from app.geometry import FloatArray, SurfaceMesh, Transform
from app.robot import Robot
from app.simulation.haptic_coupling import HapticParameters
from app.synthetic.tracker_model import TrackerModel

Collision = Literal["hull", "parts", "none"]
WORLD_FRAME = "world"


@dataclass(frozen=True, slots=True, eq=False)
class ToolEntry:
    """A tool held by ``link``; ``link_from_tool`` is rigid, ``mesh`` in the tool's frame."""

    name: str
    link: str
    mesh: SurfaceMesh
    link_from_tool: Transform
    mass_kg: float
    friction: float
    collision: Collision


@dataclass(frozen=True, slots=True, eq=False)
class RobotEntry:
    """A robot whose base link is at ``world_from_base``.

    ``positions``: joints at the start, in rad, m for sliding joints. ``max_effort`` and
    ``density_kg_m3`` are for what the robot's file leaves out, None where there is no such value.
    """

    name: str
    robot: Robot
    world_from_base: Transform
    positions: Mapping[str, float]
    density_kg_m3: float | None = None
    max_effort: float | None = None
    armature_kg_m2: float = 0.0
    friction: float = 0.3
    collision: Collision = "hull"
    self_collision: bool = False
    tool: ToolEntry | None = None
    file: Path | None = None


@dataclass(frozen=True, slots=True, eq=False)
class BodyEntry:
    """A rigid body at ``world_from_body``; free with ``mass_kg``, fixed where that is None."""

    name: str
    mesh: SurfaceMesh
    world_from_body: Transform
    mass_kg: float | None
    friction: float = 0.3
    collision: Collision = "hull"


@dataclass(frozen=True, slots=True, eq=False)
class TissueShift:
    """A displacement (3,) in mm, in the axes of the world, that begins and ends smoothly."""

    start_s: float
    end_s: float
    shift_mm: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class TissueEntry:
    """A structure in soft tissue, at ``rest`` at end expiration.

    ``breath_shift_mm`` (3,) and ``breath_turn_rad`` (3,): displacement at full inspiration.
    """

    name: str
    mesh: SurfaceMesh
    rest: Transform
    breath_shift_mm: FloatArray
    breath_turn_rad: FloatArray
    shifts: tuple[TissueShift, ...] = ()


@dataclass(frozen=True, slots=True)
class BreathingEntry:
    """Frequency of the breaths, and until when the breath is held at end expiration."""

    frequency_hz: float = 0.25
    held_until_s: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class TrackerEntry:
    """Frames that the tracker measures, and the errors of the measurement.

    ``metal``: an arm and two of its links, between which its metal distorts the field.
    """

    tracked: tuple[str, ...]
    model: TrackerModel
    metal: tuple[str, str, str] | None = None


@dataclass(frozen=True, slots=True)
class Push:
    """The hand pushes towards the origin of a named body, or away from it."""

    start_s: float
    end_s: float
    towards: str
    retreat: bool = False


@dataclass(frozen=True, slots=True)
class JoyEntry:
    """A joystick or 3D mouse: which axes of ``topic`` push along x, y and z, and with which signs.

    Axes whose length is below ``dead`` count as 0.
    """

    topic: str
    axes: tuple[int, int, int]
    signs: tuple[float, float, float]
    dead: float


@dataclass(frozen=True, slots=True, eq=False)
class DeviceEntry:
    """A haptic device with the topics of CRTK in ``namespace``.

    ``world_from_device`` (3, 3) turns its axes into those of the world.
    """

    namespace: str
    haptic: HapticParameters
    world_from_device: FloatArray


@dataclass(frozen=True, slots=True)
class HandEntry:
    """A hand on the tool of ``robot``; ``free_speed_mm_s`` is for its controller.

    Script: the pushes repeat every ``period_s``, None for pushes that are done once. ``joy`` and
    ``device`` are what a person can move it by, None without.
    """

    robot: str
    force_n: float
    free_speed_mm_s: float
    pushes: tuple[Push, ...]
    period_s: float | None = None
    joy: JoyEntry | None = None
    device: DeviceEntry | None = None


@dataclass(frozen=True, slots=True, eq=False)
class WorldDescription:
    """Everything that is simulated; ``gravity_m_s2`` is along -z of the world."""

    name: str
    seed: int
    timestep_ns: int = 1_000_000
    gravity_m_s2: float = 9.80665
    robots: tuple[RobotEntry, ...] = ()
    bodies: tuple[BodyEntry, ...] = ()
    tissues: tuple[TissueEntry, ...] = ()
    breathing: BreathingEntry = BreathingEntry()
    tracker: TrackerEntry | None = None
    hand: HandEntry | None = None
