"""What a case consists of: the values of a ``case.yaml`` or ``live.yaml``, in our units.

Every matrix is a `Transform` in mm, every duration integer nanoseconds. ``manifest_file`` and
``live_file`` read and check them.
"""

import math
from dataclasses import dataclass
from typing import Literal

from app.geometry import NS_PER_MS, InputError, Transform

REFERENCE_FRAME = "reference"
TUMOR_MESH_FRAME = "tumor"
DEFAULT_BASE_FRAME = "robot_base"

RegistrationMethod = Literal["given", "paired_points", "robot_world"]


@dataclass(frozen=True, slots=True)
class Provenance:
    """Where the data come from; ``kind`` is never guessed."""

    kind: Literal["simulated", "recorded"]
    source: str
    licence: str


@dataclass(frozen=True, slots=True)
class RecordingEntry:
    """The recording: a path as written, relative to the case, and its SHA-256 where given."""

    path: str
    sha256: str | None


@dataclass(frozen=True, slots=True)
class ClockEntry:
    """tracker = robot + ``offset_robot_to_tracker_ns``, or an offset that is to be estimated."""

    offset_robot_to_tracker_ns: int
    estimate: bool


@dataclass(frozen=True, slots=True)
class MeshEntry:
    """A mesh file as written and the unit of its numbers.

    ``repair``: whether its faults may be repaired, where that is safe, rather than refused.
    """

    path: str
    units: str
    repair: bool = False


@dataclass(frozen=True, slots=True)
class SegmentationEntry:
    """A label map file as written and which of its segments; None where it holds only one."""

    path: str
    segment: str | None


@dataclass(frozen=True, slots=True)
class ContourEntry:
    """A file of points on the tumour's surface, as written."""

    path: str


@dataclass(frozen=True, slots=True, eq=False)
class ToolEntry:
    """The tracked tool. The mesh is given in the tip's frame; None serves tip-only replays."""

    frame: str
    mesh: MeshEntry | None
    tool_from_tip: Transform

    @property
    def tip_frame(self) -> str:
        """The frame of the tip and of the mesh."""
        return self.tool_from_tip.source


@dataclass(frozen=True, slots=True, eq=False)
class TumorEntry:
    """The tumour's shape, rigid to the tracked ``frame``."""

    frame: str
    shape: MeshEntry | SegmentationEntry | ContourEntry
    frame_from_tumor: Transform

    @property
    def shape_key(self) -> str:
        """The key under which the manifest names the shape's file."""
        return "tumor.contour" if isinstance(self.shape, ContourEntry) else "tumor.mesh"


@dataclass(frozen=True, slots=True)
class RobotEntry:
    """The robot that holds the tool; without ``joint_states`` the recording holds no joints."""

    urdf: str
    base_frame: str
    tool_link: str
    joint_states: str | None


@dataclass(frozen=True, slots=True)
class Dwell:
    """The tool's tip rested on a landmark, in seconds from the recording's first frame."""

    start_s: float
    end_s: float


@dataclass(frozen=True, slots=True, eq=False)
class RegistrationEntry:
    """How the robot's base is registered: a given pose, point pairs, or times of dwelling.

    Once registered, the tool is known twice; a difference of more than ``max_drift_mm`` or
    ``max_drift_rad`` says that the registration no longer holds.
    """

    method: RegistrationMethod
    reference_from_base: Transform | None = None
    fixed_mm: tuple[tuple[float, ...], ...] = ()
    moving_mm: tuple[tuple[float, ...], ...] = ()
    dwells: tuple[Dwell, ...] = ()
    max_drift_mm: float = 5.0
    max_drift_rad: float = math.radians(3.0)


@dataclass(frozen=True, slots=True)
class MarginEntry:
    """The margins of the fixture, and what counts as stale.

    A better state is entered only after ``release_samples`` samples that lie ``release_band_mm``
    beyond the boundary; a pose that does not change at all for ``frozen_after_ns`` is frozen.
    """

    stop_mm: float
    warn_mm: float
    k_tre: float
    v_max_mm_s: float
    stale_after_ns: int
    release_samples: int = 3
    release_band_mm: float = 0.5
    frozen_after_ns: int = 1000 * NS_PER_MS


@dataclass(frozen=True, slots=True, eq=False)
class CaseManifest:
    """A whole ``case.yaml``, or what a ``live.yaml`` has in common with it.

    ``file`` is the name of the file, for messages. A live case has no ``recording``.
    """

    file: str
    name: str
    provenance: Provenance
    recording: RecordingEntry | None
    clock: ClockEntry
    tool: ToolEntry
    tumor: TumorEntry
    robot: RobotEntry | None
    registration: RegistrationEntry | None
    margins: MarginEntry
    expected: str | None

    def recorded(self) -> RecordingEntry:
        """The recording; `InputError` where the case is live and has none."""
        if self.recording is None:
            raise InputError(f"{self.file}: a live case has no recording")
        return self.recording
