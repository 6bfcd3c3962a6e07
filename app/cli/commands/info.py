"""Describe a recorded case, or a file: what it is, what it can be used for, what is missing.

A case: frames, transforms with their statuses, joints, meshes. A file: a recording, a mesh, a
robot, a transform, a configuration of PLUS, points or a segmentation.
"""

import argparse
import json
from pathlib import Path
from typing import Any

from app.cli.calibration.argument_types import rate_hz
from app.cli.options import CASE_HELP, add_json, add_package_dirs, input_argument
from app.cli.progress import with_progress

SUMMARY = "describe a recorded case, or a file that may become part of one"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of ``marginguard info``."""
    parser.add_argument(
        "path", type=input_argument, metavar="PATH", help=f"{CASE_HELP}; or any file"
    )
    add_package_dirs(parser)
    add_json(parser)
    parser.add_argument(
        "--rate-hz", type=rate_hz, metavar="HZ", help="rate of a recording without times"
    )


def run(options: argparse.Namespace) -> int:
    """Read the whole recording or file and print its description."""
    if not _is_case(options.path):
        return _describe_file(options)
    from app.case import open_case
    from app.session import with_repaired_meshes

    case = with_repaired_meshes(open_case(options.path, package_dirs=options.package_dirs))
    found = describe(case)
    print(json.dumps(found, indent=2) if options.json else as_text(found))
    return 0


def _is_case(path: Path) -> bool:
    """True for a folder with a case.yaml, and for a path that only a case can explain."""
    from app.case import recording_formats
    from app.files.bounded_io import is_file, is_folder

    if is_file(path / "case.yaml"):
        return True
    return not is_file(path) and not (
        is_folder(path) and any(each.recognises(path) for each in recording_formats())
    )


def _describe_file(options: argparse.Namespace) -> int:
    from app.cli.file_info.describe_file import describe_file
    from app.cli.file_info.recording import describe_at_rate

    found = (
        describe_file(options.path, options.package_dirs)
        if options.rate_hz is None
        else describe_at_rate(options.path, options.rate_hz)
    )
    print(json.dumps(found.as_json(), indent=2) if options.json else found.as_text())
    return 0


def describe(case: Any) -> dict[str, Any]:
    """Describe ``case`` with values that JSON can hold."""
    from app.case import RecordingInventory

    inventory = RecordingInventory()
    for frame in with_progress(case.frames(), "reading frame"):
        inventory.add(frame)
    manifest = case.manifest
    tool = manifest.tool
    meshes = {"tumor": case.tumor_mesh()}
    if tool.mesh is not None:
        meshes["tool"] = case.tool_mesh()
    return {
        "name": manifest.name,
        "provenance": {
            "kind": manifest.provenance.kind,
            "source": manifest.provenance.source,
            "licence": manifest.provenance.licence,
        },
        "recording": manifest.recorded().path,
        "frames": inventory.frames,
        "silences": inventory.silences,
        "duration_s": inventory.duration_s,
        "transforms": [
            {
                "target": edge.target,
                "source": edge.source,
                "samples": edge.samples,
                "statuses": {status.name: count for status, count in edge.statuses.items()},
            }
            for edge in inventory.edges
        ],
        "joint_samples": inventory.joint_samples,
        "joints": list(inventory.joint_names),
        "meshes": {
            name: {
                "triangles": len(mesh.faces),
                "size_mm": (mesh.bounds_mm[1] - mesh.bounds_mm[0]).round(3).tolist(),
                "volume_mm3": round(mesh.signed_volume_mm3, 3),
            }
            for name, mesh in meshes.items()
        },
        "tool": tool.frame,
        "tumor": manifest.tumor.frame,
        "robot": None if manifest.robot is None else manifest.robot.urdf,
        "registration": None if manifest.registration is None else manifest.registration.method,
        "notes": list(case.notes()),
    }


def as_text(found: dict[str, Any]) -> str:
    """Format the description as lines of text."""
    lines = [
        found["name"],
        f"  provenance     {found['provenance']['kind']}: {found['provenance']['source']}",
        f"  recording      {found['recording']}",
        f"  frames         {_frames(found)}",
    ]
    for edge in found["transforms"]:
        statuses = ", ".join(f"{count} {name}" for name, count in edge["statuses"].items())
        lines.append(f"  transform      {edge['target']} -> {edge['source']}: {statuses}")
    lines.append(
        f"  joints         {found['joint_samples']} samples of {', '.join(found['joints'])}"
        if found["joint_samples"]
        else "  joints         none"
    )
    for name, mesh in found["meshes"].items():
        size = " x ".join(f"{length:.1f}" for length in mesh["size_mm"])
        lines.append(
            f"  {name + ' mesh':<14} {mesh['triangles']} triangles, {size} mm, "
            f"{mesh['volume_mm3']:.0f} mm3"
        )
    lines += [
        f"  tool           {found['tool']}",
        f"  tumour         rigid to {found['tumor']}",
        f"  robot          {found['robot'] or 'none'}",
        f"  registration   {found['registration'] or 'none'}",
        *(f"  note           {note}" for note in found["notes"]),
    ]
    return "\n".join(lines)


def _frames(found: dict[str, Any]) -> str:
    recorded, silences = found["frames"], found["silences"]
    text = f"{recorded} in {found['duration_s']:.3f} s, silences: {silences}"
    # A replay inserts a frame without poses into each silence.
    return f"{text}, so a replay has {recorded + silences} frames" if silences else text
