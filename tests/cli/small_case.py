"""A small synthetic case: a ball on a needle, and a rod that passes it and returns."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
import yaml

from app.case.manifest.structures import as_schema_2

FRAMES = 40
Change = Callable[[dict[str, Any]], None]


def identity() -> list[float]:
    return np.eye(4).ravel().tolist()


def margins() -> dict[str, float]:
    return {"stop_mm": 1.0, "warn_mm": 5.0, "k_tre": 2.0, "v_max_mm_s": 50, "stale_after_ms": 200}


def write_small_case(folder: Path, change: Change = lambda manifest: None) -> Path:
    """Write the case; ``change`` may alter the manifest before it is written."""
    folder.mkdir()
    trimesh.creation.icosphere(subdivisions=3, radius=8.0).export(folder / "tumor.stl")
    rod = trimesh.creation.cylinder(radius=1.5, height=60.0, sections=24)
    rod.apply_translation([0.0, 0.0, 30.0])
    rod.export(folder / "rod.stl")
    (folder / "tracking.igs.mha").write_text(recording())
    mesh = {"path": "rod.stl", "units": "mm"}
    manifest = {
        "schema": 1,
        "name": "small",
        "provenance": {"kind": "simulated", "source": "written by a test", "licence": "none"},
        "recording": {"path": "tracking.igs.mha"},
        "tool": {"frame": "rod", "mesh": mesh, "tip_from": {"matrix": identity()}},
        "tumor": {
            "frame": "needle",
            "mesh": {"path": "tumor.stl", "units": "mm"},
            "pose": {"matrix": identity()},
        },
        "margins": margins(),
    }
    change(manifest)
    (folder / "case.yaml").write_text(yaml.safe_dump(manifest, sort_keys=False))
    return folder


def edit_manifest(case: Path, change: Change) -> Path:
    """Alter the manifest of a case that exists."""
    manifest = yaml.safe_load((case / "case.yaml").read_text())
    change(manifest)
    (case / "case.yaml").write_text(yaml.safe_dump(manifest, sort_keys=False))
    return case


def write_two_tools(folder: Path) -> Path:
    """The small case with a second rod, which stands 2 mm from where the first one begins.

    It is lost in frames 5 and 6.
    """
    case = write_small_case(folder)
    path = case / "tracking.igs.mha"
    lines = []
    for line in path.read_text().splitlines():
        lines.append(line)
        if "_RodToTrackerTransformStatus" in line:
            start, index = line.partition("_RodTo")[0], int(line[len("Seq_Frame") :][:4])
            pose = np.eye(4)
            pose[:3, 3] = [41.5, 0.001 * (index % 3), -30.0]
            numbers = " ".join(f"{number:g}" for number in pose.ravel())
            status = "INVALID" if index in (5, 6) else "OK"
            lines.append(f"{start}_LeftToTrackerTransform = {numbers}")
            lines.append(f"{start}_LeftToTrackerTransformStatus = {status}")
    path.write_text("\n".join([*lines, ""]))
    manifest = as_schema_2(yaml.safe_load((case / "case.yaml").read_text()))
    (tool,) = manifest["tools"]
    manifest["tools"].append({**tool, "name": "left", "frame": "left"})
    manifest["tool_distance_mm"] = 5.0
    (case / "case.yaml").write_text(yaml.safe_dump(manifest, sort_keys=False))
    return case


def recording() -> str:
    """50 ms a frame; the rod stands upright and its side passes the ball 3 mm deep at frame 20."""
    lines = ["ObjectType = Image", "NDims = 3", f"DimSize = 0 0 {FRAMES}"]
    for index in range(FRAMES):
        needle = np.eye(4)
        needle[0, 3] = 0.001 * (index % 3)
        rod = np.eye(4)
        rod[:3, 3] = [6.5 + 1.5 * abs(index - 20), 0.01 * index, -30.0]
        for name, pose in (("Needle", needle), ("Rod", rod)):
            numbers = " ".join(f"{number:g}" for number in pose.ravel())
            lines.append(f"Seq_Frame{index:04}_{name}ToTrackerTransform = {numbers}")
            lines.append(f"Seq_Frame{index:04}_{name}ToTrackerTransformStatus = OK")
        lines.append(f"Seq_Frame{index:04}_Timestamp = {100 + 0.05 * index:.3f}")
    return "\n".join([*lines, "ElementDataFile = LOCAL", ""])
