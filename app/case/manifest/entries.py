"""The values of a ``case.yaml`` or ``live.yaml``.

Every matrix is a `Transform` in mm, every duration an integer in ns. `load_manifest` and
`open_live` read and check them.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from app.case.manifest.plausibility import PlausibilityEntry
from app.geometry import InputError, Transform

REFERENCE_FRAME = "reference"
TUMOR_MESH_FRAME = "tumor"
DEFAULT_BASE_FRAME = "robot_base"

Points = tuple[tuple[float, ...], ...]
RegistrationMethod = Literal["given", "paired_points", "robot_world"]


@dataclass(frozen=True, slots=True)
class Provenance:
    """Origin of the data; ``kind`` is always stated, never inferred."""

    kind: Literal["simulated", "recorded"]
    source: str
    licence: str


@dataclass(frozen=True, slots=True)
class RecordingEntry:
    """The recording: a path as written, relative to the case, and its SHA-256 where given.

    ``rate_hz`` is that of a recording without times, None where it has them.
    """

    path: str
    sha256: str | None
    rate_hz: float | None = None


@dataclass(frozen=True, slots=True)
class ClockEntry:
    """Clock offset, tracker = robot + ``offset_robot_to_tracker_ns``, unless to be estimated."""

    offset_robot_to_tracker_ns: int
    estimate: bool


@dataclass(frozen=True, slots=True)
class MeshEntry:
    """Path of a mesh file as written, and the unit of its coordinates.

    ``repair``: whether its faults are repaired where that is safe; otherwise they are refused.
    """

    path: str
    units: str
    repair: bool = False


@dataclass(frozen=True, slots=True)
class SegmentationEntry:
    """Path of a label map as written, and its segment; None where it holds only one."""

    path: str
    segment: str | None


@dataclass(frozen=True, slots=True)
class ContourEntry:
    """Path, as written, of a file of points on the tumour's surface."""

    path: str


@dataclass(frozen=True, slots=True, eq=False)
class ToolEntry:
    """The tracked tool. The mesh is in the tip's frame; without one only the tip is replayed.

    ``sigma_mm``: standard deviation of the tip in its worst direction, 0 where it is not stated.
    """

    frame: str
    mesh: MeshEntry | None
    tool_from_tip: Transform
    sigma_mm: float = 0.0

    @property
    def tip_frame(self) -> str:
        """The frame of the tip and of the mesh."""
        return self.tool_from_tip.source


@dataclass(frozen=True, slots=True, eq=False)
class TumorEntry:
    """The tumour's shape, rigidly attached to the tracked ``frame``.

    ``sigma_mm``: standard deviation of its surface along the normal, 0 where it is not stated.
    """

    frame: str
    shape: MeshEntry | SegmentationEntry | ContourEntry
    frame_from_tumor: Transform
    sigma_mm: float = 0.0

    @property
    def shape_key(self) -> str:
        """The manifest's key of the shape, for messages."""
        return "tumor.contour" if isinstance(self.shape, ContourEntry) else "tumor.mesh"


@dataclass(frozen=True, slots=True)
class NeedleEntry:
    """A needle that is shown: its tip is ``length_mm`` along ``direction`` from its sensor.

    ``frame`` is the tracked frame of the sensor, ``direction`` a unit vector in it. ``model`` is
    in the frame of the tip; None for a generated one. No distance depends on it.
    """

    frame: str
    length_mm: float
    direction: tuple[float, float, float]
    model: MeshEntry | None

    @property
    def tip_frame(self) -> str:
        """The frame of the tip and of the model."""
        return f"{self.frame}_tip"


@dataclass(frozen=True, slots=True, eq=False)
class StylusEntry:
    """A tracked stylus with which an operator touches points. No distance depends on it.

    ``frame`` is the tracked frame of its sensor, ``frame_from_tip`` its tip with +z forward, None
    before a calibration. ``sigma_mm``: standard deviation of the tip in its worst direction, 0
    where it is not stated.
    """

    frame: str
    frame_from_tip: Transform | None
    sigma_mm: float = 0.0


@dataclass(frozen=True, slots=True)
class RobotEntry:
    """The robot that holds the tool. ``joint_states``: topic of its joints, None without any.

    ``require_meshes``: whether a missing collision mesh is an error.
    """

    urdf: str
    base_frame: str
    tool_link: str
    joint_states: str | None
    xacro_args: Mapping[str, str] = field(default_factory=dict)
    require_meshes: bool = True


@dataclass(frozen=True, slots=True)
class Dwell:
    """An interval in which the tool's tip rests on a landmark, in s from the first frame."""

    start_s: float
    end_s: float


@dataclass(frozen=True, slots=True, eq=False)
class RegistrationEntry:
    """Registration of the robot's base: by a given pose, point pairs or dwells.

    After registration the tool's pose is measured twice, by tracker and robot. A difference of more
    than ``max_drift_mm`` or ``max_drift_rad`` means that the registration no longer holds.
    ``covariance`` (36 numbers, row by row) and ``degrees_of_freedom`` belong to a given pose; None
    where they are not known.
    """

    method: RegistrationMethod
    reference_from_base: Transform | None
    fixed_mm: Points
    moving_mm: Points
    dwells: tuple[Dwell, ...]
    max_drift_mm: float
    max_drift_rad: float
    covariance: tuple[float, ...] | None = None
    degrees_of_freedom: int | None = None


@dataclass(frozen=True, slots=True)
class ImageCalibrationEntry:
    """``ImageToProbe`` by a file as written, or by 16 numbers. ``depth_mm`` None: any depth."""

    depth_mm: float | None
    path: str | None
    matrix: tuple[float, ...] | None


@dataclass(frozen=True, slots=True)
class ImagesEntry:
    """Tracked ultrasound: path as written of the sequence, and the calibrations of the probe.

    ``calibrations``: one without a depth, or one for each depth; ``depth_mm`` is then the one at
    the start. ``path`` None: the recording. ``topic``: that of the images in a bag or in a live
    session, None for a sequence and for OpenIGTLink. ``orientation`` is that of images that do not
    name it. ``stale_after_ns``: None for that of the margins.
    """

    path: str | None
    probe: str
    calibrations: tuple[ImageCalibrationEntry, ...]
    orientation: str | None
    stale_after_ns: int | None
    topic: str | None = None
    depth_mm: float | None = None


@dataclass(frozen=True, slots=True)
class CauteryEntry:
    """Source of the cautery's state: a ROS ``topic``, or an OpenIGTLink ``device``.

    Older than ``stale_after_ns`` it is unknown.
    """

    topic: str | None
    device: str | None
    stale_after_ns: int


@dataclass(frozen=True, slots=True)
class MarginEntry:
    """The margins of the fixture, and the limits of freshness.

    A better state is entered only after ``release_samples`` samples that lie ``release_band_mm``
    beyond the boundary. A pose that is constant for ``frozen_after_ns`` is frozen.
    """

    stop_mm: float
    warn_mm: float
    k_tre: float
    v_max_mm_s: float
    stale_after_ns: int
    release_samples: int
    release_band_mm: float
    frozen_after_ns: int


@dataclass(frozen=True, slots=True, eq=False)
class CaseManifest:
    """A ``case.yaml``, or the sections that a ``live.yaml`` shares with it.

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
    plausibility: PlausibilityEntry = field(default_factory=PlausibilityEntry)
    package_dirs: Mapping[str, str] = field(default_factory=dict)
    images: ImagesEntry | None = None
    needle: NeedleEntry | None = None
    stylus: StylusEntry | None = None
    cautery: CauteryEntry | None = None

    def recorded(self) -> RecordingEntry:
        """The recording; `InputError` for a live case."""
        if self.recording is None:
            raise InputError(f"{self.file}: a live case has no recording")
        return self.recording
