"""Writes a case from surfaces and tracked poses."""

from collections.abc import Iterable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import yaml

from app.case.case import open_case
from app.case.frames.samples import TrackingFrame
from app.case.manifest.case_file import MANIFEST_NAME, Provenance
from app.case.manifest.margins import MarginEntry
from app.case.manifest.parts import TUMOR_MESH_FRAME
from app.case.recorder.recorder import write_recording
from app.files.atomic_io import new_folder
from app.files.meshes import write_mesh
from app.files.paths import sha256_of
from app.geometry import NS_PER_MS, FrameError, InputError, SurfaceMesh, Transform

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
            "tool": _entry(_TOOL, tool, "tip_from"),
            "tumor": _entry(_TUMOR, tumor, "pose"),
            "margins": margin_values(margins),
        }
        text = yaml.safe_dump(manifest, sort_keys=False, default_flow_style=None, width=100)
        (partial / MANIFEST_NAME).write_text(text, encoding="utf-8")
        written = open_case(partial)
        written.tool_mesh()
        written.tumor_mesh()


def _entry(file: str, body: TrackedBody, pose_key: str) -> dict[str, Any]:
    matrix = [float(number) for number in body.frame_from_body.matrix.ravel()]
    return {
        "frame": body.frame_from_body.target,
        "mesh": {"path": file, "units": "mm"},
        pose_key: {"matrix": matrix},
    }


def margin_values(margins: MarginEntry) -> dict[str, float | int]:
    """The manifest's ``margins``: times in ms, everything else as it is."""
    values = asdict(margins)
    return {
        f"{name.removesuffix('_ns')}_ms" if name.endswith("_ns") else name: (
            value / NS_PER_MS if name.endswith("_ns") else value
        )
        for name, value in values.items()
    }
