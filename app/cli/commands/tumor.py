"""Make a tumour's mesh from contoured points or a segmentation, or check a mesh.

Contoured points (.mrk.json, .fcsv, .yaml) become the rounded convex hull around them, a segment of
a label map (.seg.nrrd, .nrrd) the smooth surface of its voxels. Coordinates are those of the file,
in RAS axes. Exit status: 0; 1 for a mesh that does not bound a solid and is not repaired: the
reason is printed and nothing is written; 2 on bad input.
"""

import argparse
import json
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from app.cli.options import add_json
from app.cli.progress import progress_with_total
from app.geometry import InputError, MeshError

if TYPE_CHECKING:
    from app.case import BuiltTumor

SUMMARY = "make a tumour's mesh from contoured points or a segmentation, or check one"
UNITS = ("mm", "cm", "m")
NOT_SOUND = 1
_STAGES = 3


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of ``marginguard tumor``."""
    parser.add_argument(
        "source", type=Path, metavar="SOURCE",
        help="points (.mrk.json, .fcsv, .yaml), segmentation (.nrrd) or mesh (.stl, .ply, .obj)",
    )  # fmt: skip
    parser.add_argument(
        "-o", "--output", type=Path, metavar="FILE", help="write the mesh, in mm (.stl, .ply)"
    )
    parser.add_argument(
        "--segment", metavar="NAME",
        help="which segment of a segmentation: its name, its ID, or a label's value; "
        "not needed where there is only one",
    )  # fmt: skip
    parser.add_argument(
        "--units", choices=UNITS, help="the unit of a mesh file, which does not store its unit"
    )
    parser.add_argument(
        "--repair", action="store_true",
        help="repair the faults that can be repaired safely, and list the repairs",
    )  # fmt: skip
    add_json(parser)


def run(options: argparse.Namespace) -> int:
    """Build or read the mesh, check it, print its description, write it."""
    from app.files import check_mesh_path, write_mesh

    if options.output is not None:
        check_mesh_path(options.output)
        # It is in mm and RAS: in place of SOURCE it would be read differently.
        if options.output.exists() and options.output.samefile(options.source):
            raise InputError(f"--output {options.output} is SOURCE; expected another file")
    with progress_with_total("building the surface, checking, measuring") as report:
        report(0, _STAGES)
        built = _tumor(options)
        report(1, _STAGES)
        tumor, reason = _checked(built, str(options.source), repair=options.repair)
        report(2, _STAGES)
        found = _described(options.source, tumor, reason)
    print(json.dumps(found, indent=2) if options.json else _as_text(found))
    if not found["sound"]:
        return NOT_SOUND
    if options.output is not None:
        write_mesh(options.output, tumor.mesh)
        if not options.json:
            print(f"wrote {options.output}")
    return 0


def _tumor(options: argparse.Namespace) -> "BuiltTumor":
    from app.case import (
        SEGMENTATION_ENDING,
        TUMOR_MESH_FRAME,
        BuiltTumor,
        tumor_from_contour,
        tumor_from_segmentation,
    )
    from app.files import MESH_ENDINGS, POINT_ENDINGS, load_mesh

    source, frame = options.source, TUMOR_MESH_FRAME
    name = source.name.lower()
    is_mesh, is_labels = name.endswith(MESH_ENDINGS), name.endswith(SEGMENTATION_ENDING)
    endings = (*POINT_ENDINGS, SEGMENTATION_ENDING, *MESH_ENDINGS)
    if not name.endswith(endings):
        raise InputError(f"{source} is not a tumour file; expected one of {', '.join(endings)}")
    if options.segment is not None and not is_labels:
        raise InputError(f"--segment is given, but {source} is not a segmentation; expected one")
    if is_mesh != (options.units is not None):
        problem = (
            "missing: a mesh file does not store its unit; expected mm, cm or m"
            if is_mesh
            else f"given, but {source} is always in mm; expected it for a mesh file only"
        )
        raise InputError(f"--units is {problem}")
    if is_mesh:
        return BuiltTumor(load_mesh(source, units=options.units, frame=frame), ())
    if is_labels:
        return tumor_from_segmentation(source, frame=frame, segment=options.segment)
    return tumor_from_contour(source, frame=frame)


def _checked(tumor: "BuiltTumor", what: str, *, repair: bool) -> tuple["BuiltTumor", str | None]:
    """The tumour, repaired where ``repair`` is true, and why it is not sound, or None."""
    from app.fixture import repair_mesh
    from app.fixture.meshes.mesh_checks import require_sound

    try:
        if repair:
            mesh, done = repair_mesh(tumor.mesh, what)
            return replace(tumor, mesh=mesh, notes=(*tumor.notes, *done)), None
        return replace(tumor, mesh=require_sound(tumor.mesh, what)), None
    except MeshError as error:
        return tumor, str(error)


def _described(source: Path, tumor: "BuiltTumor", reason: str | None) -> dict[str, Any]:
    from app.fixture.proximity.body import part_meshes

    mesh = tumor.mesh
    low, high = mesh.bounds_mm
    return {
        "source": str(source),
        "notes": list(tumor.notes),
        "triangles": len(mesh.faces),
        "parts": len(part_meshes(mesh)),
        "size_mm": (high - low).round(3).tolist(),
        "middle_mm": ((low + high) / 2.0).round(3).tolist(),
        "volume_mm3": round(mesh.signed_volume_mm3, 3),
        "sound": reason is None,
        "reason": reason,
    }


def _as_text(found: dict[str, Any]) -> str:
    size = " x ".join(f"{length:.1f}" for length in found["size_mm"])
    middle = ", ".join(f"{value:.1f}" for value in found["middle_mm"])
    rows = {
        "triangles": f"{found['triangles']} in {found['parts']} part(s)",
        "size": f"{size} mm, around ({middle}) mm",
        "volume": f"{found['volume_mm3']:.0f} mm3",
        "sound": "yes" if found["sound"] else f"no: {found['reason']}",
    }
    lines = [found["source"], *(f"  {name:<12} {row}" for name, row in rows.items())]
    return "\n".join([*lines, *(f"  {'note':<12} {note}" for note in found["notes"])])
