"""Writes a new case, or its document alone: from tracked poses, or for a live recording."""

import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import yaml

from app.case.case import Case, open_case
from app.case.conversion import copy_named_files
from app.case.frame_streams import TrackingFrame
from app.case.frames_recorder import write_recording
from app.case.live_file import (
    LIVE,
    LIVE_2,
    ONLY_LIVE,
    IgtlSourceEntry,
    LiveCase,
    TopicSourceEntry,
    open_live,
)
from app.case.manifest.case_file import CASE, CASE_2, MANIFEST_NAME, Provenance
from app.case.manifest.display_items import ENERGY_DEVICE
from app.case.manifest.expected import EXPECTED
from app.case.manifest.key_rules import MarginEntry
from app.case.manifest.parts import TUMOR_MESH_FRAME
from app.case.manifest.structures import PlainParts, as_schema_2
from app.case.messages.ros_messages import TRACKED_TRANSFORMS_TOPIC
from app.case.readers.rosbag2 import CHANGES_NAME
from app.case.session_values import (
    RegistrationValues,
    SessionValues,
    StructureValues,
    check_frames,
)
from app.files.atomic_io import new_folder, write_file
from app.files.document_text import commented_yaml
from app.files.keys import Block
from app.files.meshes import write_exact_ply, write_mesh
from app.files.paths import sha256_of
from app.files.yaml_file import load_yaml
from app.geometry import NS_PER_MS, FrameError, InputError, MarginGuardError, SurfaceMesh, Transform

_RECORDING, _TOOL, _TUMOR = "tracking.mcap", "tool.stl", "tumor.stl"


@dataclass(frozen=True, slots=True, eq=False)
class TrackedBody:
    """A closed surface that moves with a tracked frame.

    ``frame_from_body`` places the surface, in its own frame, in the tracked one. Raises
    `FrameError` for a surface in another frame.
    """

    mesh: SurfaceMesh
    frame_from_body: Transform

    def __post_init__(self) -> None:
        if self.mesh.frame != self.frame_from_body.source:
            raise FrameError(
                f"mesh: is in frame {self.mesh.frame!r}; expected "
                f"{self.frame_from_body.source!r}, which is placed in "
                f"{self.frame_from_body.target!r}"
            )

    def check_frame(self, expected: str, what: str) -> None:
        """Raise `FrameError` unless the surface is in the frame ``expected``."""
        if self.mesh.frame != expected:
            raise FrameError(f"{what}: is in frame {self.mesh.frame!r}; expected {expected!r}")


def write_case(
    folder: Path,
    frames: Iterable[TrackingFrame],
    *,
    name: str,
    provenance: Provenance,
    tool: TrackedBody,
    tumor: TrackedBody,
    margins: MarginEntry,
) -> None:
    """Write a case without a robot to ``folder``, which must not exist.

    ``frames`` are in the order of acquisition. The surface of ``tool`` is in the frame of its tip,
    the tracked frame's name with ``_tip`` added; that of ``tumor`` in ``tumor``. The case is opened
    before it appears: no folder is left after an error. Raises `FrameError` for surfaces in other
    frames, `MeshError` for open ones, and `InputError` for everything else, such as 0 frames.
    """
    tool.check_frame(f"{tool.frame_from_body.target}_tip", "tool")
    tumor.check_frame(TUMOR_MESH_FRAME, "tumor")
    recorded = list(frames)
    if not any(frame.poses for frame in recorded):
        raise InputError("poses: there are 0; expected at least 1")
    with new_folder(folder) as partial:
        write_recording(partial / _RECORDING, recorded)
        write_mesh(partial / _TOOL, tool.mesh)
        write_mesh(partial / _TUMOR, tumor.mesh)
        manifest = {
            "schema": 1,
            "name": name,
            "provenance": asdict(provenance),
            "recording": {"path": _RECORDING, "sha256": sha256_of(partial / _RECORDING)},
            "tool": placed_mesh(_TOOL, tool.frame_from_body, "tip_from"),
            "tumor": placed_mesh(_TUMOR, tumor.frame_from_body),
            "margins": margin_values(margins),
        }
        text = yaml.safe_dump(manifest, sort_keys=False, default_flow_style=None, width=100)
        (partial / MANIFEST_NAME).write_text(text, encoding="utf-8")
        written = open_case(partial)
        written.tool_mesh()
        written.tumor_mesh()


def placed_mesh(
    file: str, pose: Transform, pose_key: str = "pose", units: str = "mm"
) -> dict[str, Any]:
    """The manifest's keys of a surface in ``units``, which ``pose`` places in a tracked frame."""
    return {
        "frame": pose.target,
        "mesh": {"path": file, "units": units},
        pose_key: matrix_values(pose),
    }


def matrix_values(pose: Transform) -> dict[str, list[float]]:
    """The manifest's ``matrix``: 16 numbers, row by row."""
    return {"matrix": pose.matrix.ravel().tolist()}


def margin_values(margins: MarginEntry) -> dict[str, float | int]:
    """The manifest's ``margins``: times in ms, everything else as it is."""
    values = asdict(margins)
    return {
        f"{name.removesuffix('_ns')}_ms" if name.endswith("_ns") else name: (
            value / NS_PER_MS if name.endswith("_ns") else value
        )
        for name, value in values.items()
    }


RECORDING_FOLDER = "tracking"

TUMOR_NAME = "tumor_of_session.ply"
"""File in a recorded case of a tumour that an operator of the session has accepted."""

IGTL_IMAGES_TOPIC = "/marginguard/images"
"""Topic in a recording of the images that came over the session's OpenIGTLink connection."""


IGTL_ACTIVATION_TOPIC = f"/marginguard/{ENERGY_DEVICE.name}"
"""Topic in a recording of the activation that came over the OpenIGTLink connection."""


@dataclass(frozen=True, slots=True)
class SessionChange:
    """Tumour and registration of a session from the time ``received_ns`` (since 1970) on.

    ``replaced`` names the parts that are not those of the case.
    """

    received_ns: int
    model_id: str
    registration_id: str
    replaced: str


def write_changes(changes: Sequence[SessionChange], recording: Path) -> None:
    """Write ``changes.yaml`` to the folder ``recording``; `InputError` where that fails."""
    text = yaml.safe_dump({"changes": [asdict(change) for change in changes]}, sort_keys=False)
    write_file(recording / CHANGES_NAME, text.encode())


def begin_case(live: LiveCase, folder: Path, values: SessionValues | None = None) -> None:
    """Write ``case.yaml`` and the files that it names, except the recording, to ``folder``.

    ``folder`` must not exist. The recording is expected in the rosbag2 folder ``tracking``.
    ``values`` are those that a session uses at present in the place of those of ``live``. Raises
    `InputError` for a source that a case cannot hold, and `FrameError` for ``values`` of other
    frames.
    """
    source = live.source
    if isinstance(source, TopicSourceEntry) and source.topic != TRACKED_TRANSFORMS_TOPIC:
        raise InputError(
            f"{live.case.manifest.file}: source.tracked_transforms.topic is {source.topic!r}; "
            f"expected {TRACKED_TRANSFORMS_TOPIC}, the topic of a case"
        )
    if values is not None:
        tool, tumor = live.case.manifest.tool, live.case.manifest.tumor
        check_frames(values, tool.tool_from_tip, tumor.frame_from_tumor)
    with new_folder(folder) as partial:
        _write(live, partial, values)


def _write(live: LiveCase, folder: Path, in_use: SessionValues | None) -> None:
    is_other_tumor = in_use is not None and in_use.tumor is not None
    copy_named_files(live.case, folder, with_tumor=not is_other_tumor)
    # Not parsed again: it was checked when it was opened.
    path = live.case.folder / live.case.manifest.file
    values = load_yaml(path)
    for name in ONLY_LIVE:
        values.pop(name, None)
    if live.case.manifest.images is not None:
        values["images"].pop("device", None)
        if isinstance(live.source, IgtlSourceEntry):
            values["images"].setdefault("topic", IGTL_IMAGES_TOPIC)
    if live.case.manifest.activation is not None:
        values[ENERGY_DEVICE.name].pop("device", None)
        values[ENERGY_DEVICE.name].setdefault("topic", IGTL_ACTIVATION_TOPIC)
    robot = live.case.manifest.robot
    if live.joints_of_host and not live.stamps_of_host and robot and robot.joint_states:
        values["clock"] = {"estimate": True}  # the offset of the two clocks is unknown
    values["recording"] = {"path": RECORDING_FOLDER}
    if in_use is not None:
        if in_use.structures is not None and values["schema"] == 1:
            values = as_schema_2(values)
        _use(in_use, values, folder)
    text = yaml.safe_dump(values, sort_keys=False, allow_unicode=True)
    (folder / MANIFEST_NAME).write_text(text, encoding="utf-8")


def _use(in_use: SessionValues, values: dict[str, Any], folder: Path) -> None:
    """Replace the keys of ``values``, those of a ``case.yaml``, by the values in use."""
    parts = PlainParts.of(values, in_use.tool_from_tip.target)
    tool, tumor = parts.tool, parts.tumor
    tool["tip_from"] = matrix_values(in_use.tool_from_tip)
    tool["sigma_mm"] = in_use.tip_sigma_mm
    tumor["pose"] = matrix_values(in_use.frame_from_tumor)
    tumor["sigma_mm"] = in_use.tumor_sigma_mm
    if in_use.tumor is not None:
        write_exact_ply(folder / TUMOR_NAME, in_use.tumor)
        tumor.pop("contour", None)
        tumor["mesh"] = {"path": TUMOR_NAME, "units": "mm"}
    if in_use.structures is not None:
        others = enumerate(in_use.structures, start=1)
        values["structures"] = [tumor, *(_structure(each, n, folder) for n, each in others)]
    parts.set_margins(margin_values(in_use.margins))
    for name, keys in in_use.items.items():
        if name in values:
            values[name] |= keys
    if in_use.image_depth_mm is not None and "calibrations" in values.get("images", {}):
        values["images"]["depth_mm"] = in_use.image_depth_mm
    if in_use.registration is not None:
        placed = parts.placed
        placed["registration"] = _given(in_use.registration, placed["registration"])


def _structure(structure: StructureValues, number: int, folder: Path) -> dict[str, Any]:
    """Write the surface of ``structure`` to ``folder``; return its entry in ``case.yaml``."""
    file, pose = f"structure_{number}_of_session.ply", structure.frame_from_structure
    write_exact_ply(folder / file, structure.surface)
    return {
        "name": pose.source,
        "role": structure.role,
        **placed_mesh(file, pose),
        "sigma_mm": structure.sigma_mm,
        "margins": {"stop_mm": structure.stop_mm, "warn_mm": structure.warn_mm},
    }


def _given(registration: RegistrationValues, before: dict[str, Any]) -> dict[str, Any]:
    """The keys of a registration by its pose, with the limits of the one ``before``."""
    values: dict[str, Any] = {"method": "given", **matrix_values(registration.reference_from_base)}
    if registration.covariance is not None:
        values["covariance"] = registration.covariance.ravel().tolist()
        if registration.degrees_of_freedom is not None:
            values["degrees_of_freedom"] = registration.degrees_of_freedom
    values.update((key, before[key]) for key in ("max_drift_mm", "max_drift_deg") if key in before)
    return values


DOCUMENTS = {"case": CASE, "case-2": CASE_2, "live": LIVE, "live-2": LIVE_2, "expected": EXPECTED}
"""Name of a document, with its schema unless that is 1 -> the declaration of its keys."""


def write_case_manifest(folder: Path, values: Mapping[str, Any]) -> Path:
    """Write ``case.yaml`` with ``values`` to ``folder``, which has the files that it names.

    Returns its path. The case is opened, with its meshes: raises `MarginGuardError` for one that
    cannot be, or if there is a ``case.yaml`` already; no file is left then.
    """
    path = folder / MANIFEST_NAME
    title = "A case of MarginGuard. Every key: docs/case_format.md"
    _write_opened(path, CASE, values, title, lambda: open_case(folder))
    return path


def write_live_manifest(path: Path, values: Mapping[str, Any]) -> None:
    """Write a ``live.yaml`` with ``values`` to ``path``; raises as `write_case_manifest`."""
    title = "A live session of MarginGuard. Every key: docs/live.md"
    _write_opened(path, LIVE, values, title, lambda: open_live(path).case)


def _write_opened(
    path: Path, block: Block, values: Mapping[str, Any], title: str, opened: Callable[[], Case]
) -> None:
    if os.path.lexists(path):
        raise InputError(f"{path} already exists; refusing to overwrite it")
    write_file(path, commented_yaml(block, values, title).encode())
    try:
        case = opened()
        case.tumor_mesh()
        case.tool_mesh()
        case.item_meshes()
    except MarginGuardError:
        path.unlink()
        raise
