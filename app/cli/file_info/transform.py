"""Descriptions of transforms and PLUS configurations."""

import math
from collections.abc import Sequence
from pathlib import Path

from app.cli.file_info.file_info import FileInfo


def describe(path: Path, package_dirs: Sequence[Path]) -> FileInfo:
    """Describe a rigid transform, as Slicer displays its matrix."""
    from app.files.transforms import read_any_transform
    from app.geometry import Transform

    matrix, names = read_any_transform(path)
    pose = Transform.from_matrix(matrix, target="target", source="source")
    angle = math.degrees(pose.angle_to(Transform.identity("target", "source")))
    position = ", ".join(f"{value:.6g}" for value in pose.translation_mm)
    facts = {
        "translation": f"{position} mm",
        "rotation": f"{angle:.6g} degrees",
        "matrix": "; ".join(", ".join(f"{value:.9g}" for value in row) for row in matrix),
    }
    missing = ["its frames: only the YAML format stores them"] if names is None else []
    if names is not None:
        facts["frames"] = f"{names[0]}_from_{names[1]}"
    return FileInfo(
        str(path),
        "a rigid transform, to parent and in RAS as 3D Slicer displays it",
        facts,
        (
            f"marginguard calibrate spin RECORDING --tip-from {path}: the tip of a tool",
            "tool.tip_from, tumor.pose or registration.matrix of a case.yaml: its matrix",
        ),
        tuple(missing),
    )


def describe_plus(path: Path, package_dirs: Sequence[Path]) -> FileInfo:
    """Describe a configuration of PLUS: transforms and landmarks."""
    from app.files import read_plus_config
    from app.geometry import join_transform_name

    found = read_plus_config(path)
    transforms = [join_transform_name(source, target) for target, source in found.matrices]
    facts = {
        "transforms": ", ".join(transforms) or "none",
        "landmarks": ", ".join(found.landmarks_mm) or "none",
    }
    tips = [name for name in transforms if "TipTo" in name]
    uses = [f"--tip-from {path} of marginguard calibrate: {name}" for name in tips]
    missing = [] if tips else ["no tip of a tool like StylusTipToStylus"]
    if found.landmarks_mm:
        uses.append(f"--plus-config {path} of marginguard calibrate landmarks")
    else:
        missing.append("no landmarks of a phantom")
    return FileInfo(str(path), "a configuration of PLUS", facts, tuple(uses), tuple(missing))
