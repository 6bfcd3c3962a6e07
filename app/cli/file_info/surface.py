"""Descriptions of meshes and segmentations."""

from collections.abc import Sequence
from pathlib import Path

from app.cli.file_info.file_info import FileInfo

_MIN_SIZE = 1.0


def describe(path: Path, package_dirs: Sequence[Path]) -> FileInfo:
    """Describe a mesh file, and say whether it bounds a solid."""
    from app.files.meshes import load_mesh
    from app.fixture.meshes.mesh_checks import require_sound
    from app.geometry import MeshError

    mesh = load_mesh(path, units="mm", frame="mesh")
    lengths = mesh.bounds_mm[1] - mesh.bounds_mm[0]
    size = " x ".join(f"{length:.6g}" for length in lengths)
    # A tool of less than 1 mm in mm is one in metres.
    units = "m" if max(lengths) < _MIN_SIZE else "mm"
    if units == "m":
        mesh = load_mesh(path, units=units, frame="mesh")
    uses: tuple[str, ...] = (f"tool.mesh or tumor.mesh of a case.yaml, with units: {units}",)
    missing = [f"units: the file does not store them; by its size it is in {units}"]
    try:
        require_sound(mesh, f"in {units} it")
        solid = f"yes, {mesh.signed_volume_mm3:.6g} mm3"
    except MeshError as error:
        solid = f"no: {error}"
        uses = (f"marginguard tumor {path} --units {units} --repair: tries to repair it",)
        missing.append("a tool or a tumour needs a mesh that bounds a solid")
    facts = {"triangles": str(len(mesh.faces)), "size": f"{size} units", "bounds a solid": solid}
    return FileInfo(str(path), "a triangle mesh", facts, uses, tuple(missing))


def describe_segmentation(path: Path, package_dirs: Sequence[Path]) -> FileInfo:
    """Describe a segmentation by the surface of its only segment, or by the names it has."""
    from app.case import tumor_from_segmentation
    from app.geometry import InputError

    missing: tuple[str, ...] = ()
    facts = {}
    try:
        built = tumor_from_segmentation(path, frame="tumor", segment=None)
        facts["surface"] = f"{len(built.mesh.faces)} triangles"
        facts["volume"] = f"{built.mesh.signed_volume_mm3:.6g} mm3"
    except InputError as error:
        if "segment" not in str(error):
            raise
        missing = (str(error),)
    return FileInfo(
        str(path),
        "a segmentation or label map",
        facts,
        ("tumor.mesh of a case.yaml", f"marginguard tumor {path}"),
        missing,
    )
