"""An opened case: its files are found and checked, its recording can be read repeatedly."""

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from app.case.frame_streams import TrackingFrame, read_ahead, with_watchdog
from app.case.manifest.case_file import CaseManifest, ClockEntry, load_manifest
from app.case.manifest.display_items import ENERGY_DEVICE
from app.case.manifest.expected import Expected, load_expected
from app.case.manifest.key_rules import REFERENCE_FRAME
from app.case.manifest.parts import ContourEntry, MeshEntry, ToolEntry, TumorEntry
from app.case.manifest.robot import DEFAULT_BASE_FRAME
from app.case.readers.recording_format import (
    RawMessage,
    RecordingFormat,
    SideTopics,
    format_of,
    note_to,
    read_recording,
    recording_kinds,
)
from app.case.tumor import tumor_from_contour, tumor_from_segmentation
from app.files.bounded_io import is_folder
from app.files.meshes import load_mesh
from app.files.paths import (
    PACKAGE_SCHEME,
    resolve_file,
    resolve_inside,
    resolve_package_folder,
    sha256_of,
)
from app.geometry import InputError, MeshError, SurfaceMesh


@dataclass(frozen=True, slots=True, eq=False)
class Case:
    """A case with a valid manifest and existing files; made by `open_case` and `open_live`.

    ``recording_path`` is None where the case is live.
    """

    folder: Path
    manifest: CaseManifest
    recording_path: Path | None
    package_dirs: tuple[Path, ...] = ()
    _notes: list[str] = field(default_factory=list)
    _meshes: dict[str, SurfaceMesh] = field(default_factory=dict)
    _mesh_notes: list[str] = field(default_factory=list)
    _frames: tuple[TrackingFrame, ...] | None = None

    @property
    def has_joints(self) -> bool:
        """True if the recording holds the robot's joints."""
        return self.manifest.robot is not None and self.manifest.robot.joint_states is not None

    def frames(self) -> Iterator[TrackingFrame]:
        """Yield the recording's frames, and a frame without poses in each gap that is too long."""
        frames = read_ahead(self.recorded_frames())
        return with_watchdog(frames, self.manifest.margins.stale_after_ns)

    def recorded_frames(self) -> Iterator[TrackingFrame]:
        """Yield the recording's own frames; joint stamps are on the tracker's clock.

        MCAP and MRML frames come ordered by acquisition stamp, IGSIO frames in the file's order.
        """
        self._notes.clear()  # a second reading repeats them
        path = self.recording_path
        if path is None:
            raise InputError(f"{self.manifest.file}: a live case has no recording to read")
        if self._frames is not None:
            return iter(self._frames)
        clock, recording = self.manifest.clock, self.manifest.recording
        if self.has_joints and clock.estimate:
            raise InputError(
                f"{self.manifest.file}: clock.estimate is true: estimate the offset of the joints' "
                "clock before their stamps are used (Case.with_joint_offset)"
            )
        topics = self._side_topics(clock.offset_robot_to_tracker_ns)
        rate_hz = None if recording is None else recording.rate_hz
        return read_recording(path, note_to(self._notes), topics, rate_hz)

    def recorded_messages(self) -> Iterator[RawMessage] | None:
        """Yield all messages of the recording as recorded; None for a format without messages."""
        path = self.recording_path
        messages = None if path is None else format_of(path).messages
        if path is None or messages is None:
            return None
        self._notes.clear()
        return messages(path, note_to(self._notes))

    def copied_frames(self, path: Path) -> Iterator[TrackingFrame]:
        """Yield the frames of ``path``, a copy of the recording; its notes follow the present ones.

        Joint stamps stay on the robot's clock.
        """
        return read_recording(path, note_to(self._notes), self._side_topics())

    def _side_topics(self, offset_ns: int = 0) -> SideTopics:
        robot, activation = self.manifest.robot, self.manifest.activation
        joints = None if robot is None else robot.joint_states
        if activation is None:
            return SideTopics(joints, offset_ns)
        return SideTopics(joints, offset_ns, activation.topic, activation.stale_after_ns)

    def with_joint_offset(self, offset_ns: int) -> "Case":
        """A copy of the case with a known clock offset: tracker = robot + ``offset_ns``.

        Raises `InputError` for a case that was opened with its frames.
        """
        if self._frames is not None:
            raise InputError(
                f"{self.manifest.file}: opened with frames, whose joints have the tracker's clock; "
                "expected a recording to read"
            )
        clock = ClockEntry(offset_ns, estimate=False)
        return replace(self, manifest=replace(self.manifest, clock=clock), _notes=[])

    def notes(self) -> tuple[str, ...]:
        """Notes about the tumour once it is built, and about the last reading once it has ended."""
        return (*self._mesh_notes, *self._notes)

    def add_notes(self, notes: Sequence[str]) -> None:
        """Add sentences on the case's files to its notes, each once."""
        self._mesh_notes.extend(note for note in notes if note not in self._mesh_notes)

    def tool_mesh(self) -> SurfaceMesh:
        """The tool's closed surface in the frame of its tip."""
        tool = self.manifest.tool
        if tool.mesh is None:
            raise MeshError(
                f"{self.manifest.file}: tool.mesh is missing; expected one, which only a tip-only "
                "replay does not need"
            )
        return self._mesh(tool.mesh, tool.tip_frame, "tool.mesh")

    def other_tool_meshes(self) -> dict[str, SurfaceMesh]:
        """The surfaces of the other tools that have one, in the frames of their tips, by name."""
        return {
            arm.name: self._mesh(arm.tool.mesh, arm.tool.tip_frame, arm.mesh_key)
            for arm in self.manifest.other_arms
            if arm.tool.mesh is not None
        }

    def tumor_mesh(self) -> SurfaceMesh:
        """The tumour's closed surface in its own frame; read or built once and cached."""
        return self.structure_mesh(self.manifest.tumor)

    def structure_mesh(self, structure: TumorEntry) -> SurfaceMesh:
        """The closed surface of one structure of the manifest, as `tumor_mesh`."""
        shape, key = structure.shape, structure.shape_key
        frame = structure.frame_from_tumor.source
        if isinstance(shape, MeshEntry):
            return self._mesh(shape, frame, key)
        if key not in self._meshes:
            path = self.file(shape.path, f"{key}.path")
            if isinstance(shape, ContourEntry):
                built = tumor_from_contour(path, frame=frame)
            else:
                built = tumor_from_segmentation(path, frame=frame, segment=shape.segment)
            self._meshes[key] = built.mesh
            self._mesh_notes.extend(built.notes)
        return self._meshes[key]

    def for_tool(self, name: str | None) -> "Case":
        """A copy of the case with its tool ``name``, None for its only one.

        Raises `InputError` for another name, and for None with several tools.
        """
        if name is not None:
            return replace(self, manifest=self.manifest.for_tool(name), _notes=[])
        names = [arm.name for arm in self.manifest.arms]
        if len(names) > 1:
            raise InputError(
                f"{self.manifest.file}: tools: there are {len(names)}; expected the name of one "
                f"of {', '.join(names)} (--tool)"
            )
        return self

    def item_meshes(self) -> dict[str, SurfaceMesh]:
        """The models of display items in the frames of their tips, by name."""
        return {
            name: load_mesh(
                self.file(model.path, f"{name}.model.path"), units=model.units, frame=frame
            )
            for name, model, frame in self.manifest.item_models
        }

    def faulty_mesh(self, of: TumorEntry | ToolEntry) -> SurfaceMesh:
        """The surface as in its file, to be repaired and passed to `with_repaired_mesh`.

        ``of`` is a tool of the manifest or one of its structures.
        """
        entry, frame, key = self._repairable(of)
        if not entry.repair:
            raise InputError(
                f"{self.manifest.file}: {key}.repair is not true: its mesh is used unrepaired"
            )
        path = self.file(entry.path, f"{key}.path")
        return load_mesh(path, units=entry.units, frame=frame)

    def with_repaired_mesh(
        self, of: TumorEntry | ToolEntry, mesh: SurfaceMesh, notes: Sequence[str]
    ) -> "Case":
        """A copy of the case with this mesh of ``of``; ``notes`` list the repairs."""
        entry, _, key = self._repairable(of)
        repaired, manifest = replace(entry, repair=False), self.manifest
        if of is manifest.tool:
            manifest = replace(manifest, tool=replace(manifest.tool, mesh=repaired))
        elif isinstance(of, ToolEntry):
            tool = replace(of, mesh=repaired)
            arms = [replace(arm, tool=tool) if arm.tool is of else arm for arm in manifest.arms]
            manifest = replace(manifest, arms=tuple(arms))
        elif of is manifest.tumor:
            manifest = replace(manifest, tumor=replace(of, shape=repaired))
        else:
            structures = [
                replace(each, shape=repaired) if each is of else each
                for each in manifest.structures
            ]
            manifest = replace(manifest, structures=tuple(structures))
        return replace(
            self,
            manifest=manifest,
            _notes=[],
            _meshes={**self._meshes, key: mesh},
            _mesh_notes=[*self._mesh_notes, *notes],
        )

    def _repairable(self, of: TumorEntry | ToolEntry) -> tuple[MeshEntry, str, str]:
        """Entry, frame and key of a mesh file."""
        if isinstance(of, ToolEntry):
            keys = [arm.mesh_key for arm in self.manifest.other_arms if arm.tool is of]
            found: tuple[object, str, str] = of.mesh, of.tip_frame, (keys or ["tool.mesh"])[0]
        else:
            found = of.shape, of.frame_from_tumor.source, of.shape_key
        entry, frame, key = found
        if not isinstance(entry, MeshEntry):
            what = f"{self.manifest.file}: {key.rpartition('.')[0]}.mesh"
            raise InputError(f"{what} is not a mesh file: nothing to repair")
        return entry, frame, key

    def with_own_packages(self) -> "Case":
        """A copy of the case that finds packages in the manifest's ``package_dirs``, too.

        Those of the caller precede them. Raises `InputError` for a folder that does not exist, and
        for one in the case folder where the robot is a xacro file.
        """
        robot, entries = self.manifest.robot, []
        for name, folder in self.manifest.package_dirs.items():
            where = f"{self.manifest.file}: package_dirs.{name}"
            path = resolve_package_folder(self.folder, folder, where)
            if robot is not None and _is_xacro(robot.urdf) and self._is_inside(path):
                raise InputError(
                    f"{where} is {folder!r}: it is in the case folder and could give code to "
                    "robot.urdf, which is xacro; expected a folder outside the case folder"
                )
            entries.append(Path(f"{name}={path}"))
        return replace(self, package_dirs=(*self.package_dirs, *entries))

    def robot_urdf(self) -> Path:
        """Path of the robot's file; `InputError` for a case without one or with its own xacro."""
        robot = self.manifest.robot
        if robot is None:
            raise InputError(f"{self.manifest.file}: robot is missing: the case has no robot")
        path = self.file(robot.urdf, "robot.urdf")
        is_named_by_user = robot.urdf.startswith(PACKAGE_SCHEME)
        if _is_xacro(robot.urdf) and not is_named_by_user and self._is_inside(path):
            raise InputError(
                f"{self.manifest.file}: robot.urdf is {robot.urdf!r}: a xacro file is code and is "
                "not read from the case folder; expected a package or an absolute path outside it, "
                "or the expanded URDF"
            )
        return path

    def _is_inside(self, path: Path) -> bool:
        return path.resolve().is_relative_to(self.folder.resolve())

    def check_files(self) -> None:
        """Raise `InputError` unless the files of structures, tool, items and robot exist."""
        for structure in (self.manifest.tumor, *self.manifest.structures):
            self.file(structure.shape.path, f"{structure.shape_key}.path")
        others = ((arm.mesh_key, arm.tool.mesh) for arm in self.manifest.other_arms)
        for key, mesh in (("tool.mesh", self.manifest.tool.mesh), *others):
            if mesh is not None:
                self.file(mesh.path, f"{key}.path")
        for name, model, _ in self.manifest.item_models:
            self.file(model.path, f"{name}.model.path")
        if self.manifest.robot is not None:
            self.robot_urdf()
        if self.manifest.images is not None:
            from app.case.case_images import image_depths, open_case_images

            if self.manifest.recording is None:  # a live session
                image_depths(self, self.manifest.images)
            elif (images := open_case_images(self)) is not None:
                images.close()

    def expected(self) -> Expected | None:
        """The expected results of a correct replay; None where the case does not state them."""
        if self.manifest.expected is None:
            return None
        robot = self.manifest.robot
        return load_expected(
            self.file(self.manifest.expected, "expected"),
            reference=REFERENCE_FRAME,
            robot_base=robot.base_frame if robot else DEFAULT_BASE_FRAME,
        )

    def _mesh(self, entry: MeshEntry, frame: str, key: str) -> SurfaceMesh:
        if key not in self._meshes:
            if entry.repair:
                raise InputError(
                    f"{self.manifest.file}: {key}.repair is true: repair the mesh before its use "
                    "(Case.with_repaired_mesh)"
                )
            path = self.file(entry.path, f"{key}.path")
            mesh = load_mesh(path, units=entry.units, frame=frame)
            what = f"the mesh {path} ({self.manifest.file}: {key})"
            self._meshes[key] = mesh.require_closed(what)
        return self._meshes[key]

    def file(self, name: str, key: str) -> Path:
        """Path of an existing file that ``key`` of the manifest names; `InputError` for none."""
        where = f"{self.manifest.file}: {key}"
        return resolve_file(self.folder, name, where, package_dirs=self.package_dirs)


def _is_xacro(urdf: str) -> bool:
    return urdf.lower().endswith(".xacro")


def open_case(
    folder: Path,
    *,
    package_dirs: Sequence[Path] = (),
    frames: tuple[TrackingFrame, ...] | None = None,
) -> Case:
    """Open the case in ``folder`` and check it: manifest, names, files, SHA-256, recording.

    ``frames`` are those of a recording that was not written, joint stamps on the tracker's clock:
    no file is read or checked for it. Raises `InputError` for the first fault. Meshes are read on
    first use.
    """
    if not is_folder(folder):
        exists = os.path.lexists(folder)
        problem = "expected a folder with a case.yaml" if exists else "no such folder"
        raise InputError(f"{folder} is not a case: {problem}")
    manifest = load_manifest(folder)
    entry = manifest.recorded()
    where = "case.yaml: recording.path"
    if frames is not None:
        recording = folder / entry.path
    elif entry.path.startswith(PACKAGE_SCHEME):
        recording = resolve_file(folder, entry.path, where, package_dirs=package_dirs)
    else:
        recording = resolve_inside(folder, entry.path, where)
    case = Case(folder, manifest, recording, tuple(package_dirs), _frames=frames)
    case = case.with_own_packages()
    recording_format = None if frames is not None else _check_recording(recording, entry.sha256)
    case.check_files()
    if recording_format is not None:
        _check_topics(case, recording, recording_format)
    case.expected()
    return case


def _check_topics(case: Case, recording: Path, recording_format: RecordingFormat) -> None:
    """Raise `InputError` for topics in the manifest that the format cannot hold."""
    key = what = ""
    if case.has_joints and not recording_format.has_joints:
        key, what = "robot.joint_states", "joints"
    elif case.manifest.activation is not None and recording_format.messages is None:
        key, what = ENERGY_DEVICE.name, "topics"
    if key:
        raise InputError(f"case.yaml: {key} is given: {recording.name} cannot hold {what}")


def _check_recording(path: Path, sha256: str | None) -> RecordingFormat:
    if path.is_dir():
        if sha256 is not None:
            raise InputError("case.yaml: recording.sha256 is given for a folder; expected a file")
        for part in path.iterdir():
            resolve_inside(path, part.name, f"a part of the recording {path}")
    elif not path.is_file():
        raise InputError(
            f"case.yaml: recording.path is {path.name!r}; expected an existing file or folder"
        )
    try:
        recording_format = format_of(path)
    except InputError as error:
        raise InputError(
            f"case.yaml: recording.path is {path.name!r}; expected one of {recording_kinds()}"
        ) from error
    if sha256 is not None and (found := sha256_of(path)) != sha256:
        raise InputError(f"case.yaml: recording.sha256 is {sha256}: {path.name} has {found}")
    recording_format.check(path)
    return recording_format
