"""Description of named points."""

from collections.abc import Sequence
from pathlib import Path

from app.cli.file_info.file_info import FileInfo

_MIN_CONTOUR = 4


def describe(path: Path, package_dirs: Sequence[Path]) -> FileInfo:
    """Describe landmarks or a contour."""
    from app.files.landmarks import read_points

    points = read_points(path)
    names = [name for name, _ in points]
    low = [min(point[axis] for _, point in points) for axis in range(3)]
    high = [max(point[axis] for _, point in points) for axis in range(3)]
    size = " x ".join(f"{b - a:.6g}" for a, b in zip(low, high, strict=True))
    uses, missing = [], []
    if len(names) >= _MIN_CONTOUR:
        uses.append(f"tumor.contour of a case.yaml, marginguard tumor {path}")
    else:
        missing.append(f"a contour of a tumour needs {_MIN_CONTOUR} points")
    if all(names) and len(set(names)) == len(names):
        uses.append(f"marginguard calibrate landmarks RECORDING --landmarks {path}")
    else:
        missing.append("landmarks need different names")
    shown = ", ".join(name or "(no name)" for name in names[:12])
    facts = {
        "points": f"{len(points)}, in RAS axes",
        "extent": f"{size} mm",
        "names": shown + (" ..." if len(names) > 12 else ""),
    }
    return FileInfo(str(path), "named points", facts, tuple(uses), tuple(missing))
