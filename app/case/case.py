"""An opened case: its files found and checked, its recording read as often as wanted."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from app.case.bag.mcap import read_mcap
from app.case.frames.read_ahead import read_ahead
from app.case.frames.samples import TrackingFrame
from app.case.frames.watchdog import with_watchdog
from app.case.igsio import check_igsio_header, read_igsio
from app.case.manifest.case_file import load_manifest
from app.case.manifest.entries import (
    DEFAULT_BASE_FRAME,
    REFERENCE_FRAME,
    TUMOR_MESH_FRAME,
    CaseManifest,
    ClockEntry,
    ContourEntry,
    MeshEntry,
    SegmentationEntry,
)
from app.case.manifest.expected import Expected, load_expected
from app.case.mrml.files import MRML_ENDINGS
from app.case.mrml.recording import check_mrml, read_mrml
from app.case.tumor import BuiltTumor, tumor_from_contour, tumor_from_segmentation
from app.files.meshes import load_mesh
from app.files.paths import PACKAGE_SCHEME, resolve_file, resolve_inside, sha256_of
from app.geometry import InputError, MeshError, SurfaceMesh

_IGSIO_ENDINGS = (".igs.mha", ".igs.nrrd")
_WITHOUT_JOINTS = (*_IGSIO_ENDINGS, *MRML_ENDINGS)
_READABLE = ".mcap, a rosbag2 folder, .igs.mha, .igs.nrrd, .mrb or .mrml"


@dataclass(frozen=True, slots=True, eq=False)
class Case:
    """A case whose manifest holds and whose files are there: by `open_case` or `open_live`.

    ``recording_path`` is None where the case is live.
    """

    folder: Path
    manifest: CaseManifest
    recording_path: Path | None
    package_dirs: tuple[Path, ...] = ()
    _notes: list[str] = field(default_factory=list)
    _meshes: dict[str, SurfaceMesh] = field(default_factory=dict)
    _mesh_notes: list[str] = field(default_factory=list)

    @property
    def has_joints(self) -> bool:
        """Whether the recording holds the robot's joints."""
        return self.manifest.robot is not None and self.manifest.robot.joint_states is not None

    def frames(self) -> Iterator[TrackingFrame]:
        """The recording's frames, and a frame without poses wherever it fell silent too long."""
        frames = read_ahead(self.recorded_frames())
        return with_watchdog(frames, self.manifest.margins.stale_after_ns)

    def recorded_frames(self) -> Iterator[TrackingFrame]:
        """The recording's own frames, streamed, joint stamps on the tracker's clock.

        MCAP and MRML frames come ordered by acquisition stamp, IGSIO frames as the file has them.
        """
        # A second reading says the same again.
        self._notes.clear()
        path = self.recording_path
        if path is None:
            raise InputError(f"{self.manifest.file}: a live case has no recording to be read")
        if path.name.lower().endswith(_IGSIO_ENDINGS):
            return read_igsio(path, self._notes.append)
        if path.name.lower().endswith(MRML_ENDINGS):
            return read_mrml(path, self._notes.append)
        robot, clock = self.manifest.robot, self.manifest.clock
        if self.has_joints and clock.estimate:
            raise InputError(
                f"{self.manifest.file}: clock.estimate is true: the joints have no time before the "
                "offset of their clock is estimated (Case.with_joint_offset)"
            )
        return read_mcap(
            path,
            self._notes.append,
            joint_states_topic=robot.joint_states if robot else None,
            offset_ns=clock.offset_robot_to_tracker_ns,
        )

    def with_joint_offset(self, offset_ns: int) -> "Case":
        """The same case with a known offset: tracker = robot + ``offset_ns``."""
        clock = ClockEntry(offset_ns, estimate=False)
        return replace(self, manifest=replace(self.manifest, clock=clock), _notes=[])

    def notes(self) -> tuple[str, ...]:
        """What there is to say of the tumour, once built, and of the last reading, once ended."""
        return (*self._mesh_notes, *self._notes)

    def tool_mesh(self) -> SurfaceMesh:
        """The tool's closed surface in the frame of its tip."""
        tool = self.manifest.tool
        if tool.mesh is None:
            raise MeshError(
                f"{self.manifest.file}: tool.mesh is missing: only a tip-only replay goes without"
            )
        return self._mesh(tool.mesh, tool.tip_frame, "tool.mesh")

    def tumor_mesh(self) -> SurfaceMesh:
        """The tumour's closed surface, in the frame ``tumor``: read, or built and then kept."""
        tumor = self.manifest.tumor
        if isinstance(tumor.shape, MeshEntry):
            return self._mesh(tumor.shape, TUMOR_MESH_FRAME, tumor.shape_key)
        if tumor.shape_key not in self._meshes:
            built = self._built(tumor.shape, tumor.shape_key)
            self._meshes[tumor.shape_key] = built.mesh
            self._mesh_notes.extend(built.notes)
        return self._meshes[tumor.shape_key]

    def faulty_tumor_mesh(self) -> SurfaceMesh:
        """The tumour's surface as its file has it, for who repairs it (`with_tumor_mesh`)."""
        tumor = self.manifest.tumor
        if not (isinstance(tumor.shape, MeshEntry) and tumor.shape.repair):
            raise InputError(
                f"{self.manifest.file}: tumor.mesh.repair is not true: its mesh is used as it is"
            )
        path = self._file(tumor.shape.path, f"{tumor.shape_key}.path")
        return load_mesh(path, units=tumor.shape.units, frame=TUMOR_MESH_FRAME)

    def with_tumor_mesh(self, mesh: SurfaceMesh, notes: Sequence[str]) -> "Case":
        """The same case with its tumour's mesh repaired; ``notes`` say what was done to it."""
        tumor = self.manifest.tumor
        if not isinstance(tumor.shape, MeshEntry):
            raise InputError(
                f"{self.manifest.file}: tumor.mesh is no mesh file: there is nothing to repair"
            )
        tumor_done = replace(tumor, shape=replace(tumor.shape, repair=False))
        return replace(
            self,
            manifest=replace(self.manifest, tumor=tumor_done),
            _notes=[],
            _meshes={**self._meshes, tumor.shape_key: mesh},
            _mesh_notes=list(notes),
        )

    def robot_urdf(self) -> Path:
        """The robot's file; `InputError` when the case has no robot, or brings one that is code."""
        robot = self.manifest.robot
        if robot is None:
            raise InputError(f"{self.manifest.file}: robot is missing: the case has none")
        if robot.urdf.lower().endswith(".xacro") and not robot.urdf.startswith(PACKAGE_SCHEME):
            raise InputError(
                f"{self.manifest.file}: robot.urdf is {robot.urdf!r}: a xacro file is code and is "
                "taken from a package alone, not from the case itself; expand it"
            )
        return self._file(robot.urdf, "robot.urdf")

    def check_files(self) -> None:
        """`InputError` unless the files of tumour, tool and robot are there."""
        tumor, tool = self.manifest.tumor, self.manifest.tool
        self._file(tumor.shape.path, f"{tumor.shape_key}.path")
        if tool.mesh is not None:
            self._file(tool.mesh.path, "tool.mesh.path")
        if self.manifest.robot is not None:
            self.robot_urdf()

    def expected(self) -> Expected | None:
        """What a correct replay must show, where the case says so."""
        if self.manifest.expected is None:
            return None
        robot = self.manifest.robot
        return load_expected(
            self._file(self.manifest.expected, "expected"),
            reference=REFERENCE_FRAME,
            robot_base=robot.base_frame if robot else DEFAULT_BASE_FRAME,
        )

    def _mesh(self, entry: MeshEntry, frame: str, key: str) -> SurfaceMesh:
        if key not in self._meshes:
            if entry.repair:
                raise InputError(
                    f"{self.manifest.file}: {key}.repair is true: the mesh has no use before it "
                    "is repaired (Case.with_tumor_mesh)"
                )
            path = self._file(entry.path, f"{key}.path")
            mesh = load_mesh(path, units=entry.units, frame=frame)
            self._meshes[key] = mesh.require_closed(
                f"the mesh {path} ({self.manifest.file}: {key})"
            )
        return self._meshes[key]

    def _built(self, entry: SegmentationEntry | ContourEntry, key: str) -> BuiltTumor:
        path = self._file(entry.path, f"{key}.path")
        if isinstance(entry, ContourEntry):
            return tumor_from_contour(path, frame=TUMOR_MESH_FRAME)
        return tumor_from_segmentation(path, frame=TUMOR_MESH_FRAME, segment=entry.segment)

    def _file(self, name: str, key: str) -> Path:
        where = f"{self.manifest.file}: {key}"
        return resolve_file(self.folder, name, where, package_dirs=self.package_dirs)


def open_case(folder: Path, *, package_dirs: Sequence[Path] = ()) -> Case:
    """Check the case in ``folder``: manifest, names, existence, SHA-256, IGSIO header or scene.

    Raises `InputError` for the first thing that is wrong. Meshes are read when asked for.
    """
    if not folder.is_dir():
        found = "a folder with a case.yaml wanted" if folder.exists() else "no such folder"
        raise InputError(f"{folder} is no case: {found}")
    manifest = load_manifest(folder)
    entry = manifest.recorded()
    recording = resolve_inside(folder, entry.path, "case.yaml: recording.path")
    case = Case(folder, manifest, recording, tuple(package_dirs))
    _check_recording(recording, entry.sha256)
    case.check_files()
    if case.has_joints and recording.name.lower().endswith(_WITHOUT_JOINTS):
        raise InputError(
            f"case.yaml: robot.joint_states is given: {recording.name} cannot hold joints"
        )
    case.expected()
    return case


def _check_recording(path: Path, sha256: str | None) -> None:
    name = path.name.lower()
    if path.is_dir():
        if sha256 is not None:
            raise InputError("case.yaml: recording.sha256 is given for a folder: a file wanted")
        for part in path.iterdir():
            resolve_inside(path, part.name, f"a part of the recording {path}")
        return
    if not path.is_file():
        raise InputError(f"case.yaml: recording.path is {path.name!r}: a file or a folder wanted")
    if not name.endswith((".mcap", *_WITHOUT_JOINTS)):
        raise InputError(f"case.yaml: recording.path is {path.name!r}: {_READABLE} can be read")
    if sha256 is not None:
        found = sha256_of(path)
        if found != sha256:
            raise InputError(f"case.yaml: recording.sha256 is {sha256}: {path.name} has {found}")
    if name.endswith(_IGSIO_ENDINGS):
        check_igsio_header(path)
    elif name.endswith(MRML_ENDINGS):
        check_mrml(path)
