"""Describe a recorded case: frames, transforms with their statuses, joints, meshes."""

import argparse
import json
from typing import Any

from app.cli.options import add_case, add_json
from app.cli.progress import with_progress

SUMMARY = "describe a recorded case"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of ``marginguard info``."""
    add_case(parser)
    add_json(parser)


def run(options: argparse.Namespace) -> int:
    """Read the whole recording and print its description."""
    from app.case import open_case
    from app.session import with_repaired_tumor

    case = with_repaired_tumor(open_case(options.case, package_dirs=options.package_dirs))
    found = describe(case)
    print(json.dumps(found, indent=2) if options.json else as_text(found))
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
