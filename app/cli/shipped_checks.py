"""Checks that the files that MarginGuard ships are there: case, robots, page, modules."""

from importlib import metadata
from importlib.resources import files
from pathlib import Path

from app.cli.system_checks import Check, checked
from app.files.extras import DISTRIBUTION, GUIDE
from app.files.shipped import checkout, shipped

CASE = Path("data", "recorded_case")
TOUCH = Path("data", "robots", "touch")
MODULES = Path("slicer_module")

SHIPPED = {
    "shipped case": tuple(
        CASE / name
        for name in ("case.yaml", "expected.yaml", "tracking.mcap", "cautery.stl", "tumor.stl")
    ),
    "shipped robots": (TOUCH / "touch.urdf", TOUCH / "meshes" / "stylus_collision.stl"),
    "live example": (Path("data", "live_example", "live.yaml"),),
    "Slicer modules": (MODULES / "MarginGuard" / "MarginGuard.py", MODULES / "ROS2" / "ROS2.py"),
    "RViz": (Path("rviz", "margin.rviz"),),
    "Foxglove": (Path("foxglove", "marginguard.json"),),
    "launch files": tuple(
        Path("launch", f"{name}.launch.py") for name in ("live", "replay", "rviz")
    ),
    "examples": (Path("examples", "README.md"),),
    "benchmarks": (Path("benchmarks", "fixture", "__main__.py"),),
}
"""Name of a check -> files that must exist and not be empty."""

PAGE = (
    "page.html", "page.css", "main.js", "modes.js", "accessible.js", "keys.js", "alarm.js",
    "client.js",
    "watch.js", "icon.svg", "ultrasound.js", "ultrasound.css", "contour.js", "contour.css",
    "calibration.js", "calibration.css", "guided.js", "registration.js", "tool_choice.js",
    "world.css", "world.js",
    "timeline.js", "operator.js", "library.html", "library.css", "library.js",
)  # fmt: skip


def check_shipped() -> list[Check]:
    """One check for each group of shipped files, and one for all files of an installed wheel."""
    web = Path(str(files("app"))) / "viewer" / "web"
    groups = {name: [shipped(*path.parts) for path in paths] for name, paths in SHIPPED.items()}
    groups["page"] = [web / name for name in PAGE]
    checks = [_check_group(name, paths) for name, paths in groups.items()]
    return checks if checkout() else [*checks, check_record()]


def check_record() -> Check:
    """Check that each file of the installed wheel exists with the size that pip recorded."""
    try:
        entries = metadata.files(DISTRIBUTION) or []
    except metadata.PackageNotFoundError:
        return Check("installed files", False, "not installed by pip", _remedy())
    recorded = {Path(str(entry.locate())): entry.size for entry in entries if entry.size}
    wrong = [path for path, size in recorded.items() if _size(path) != size]
    found = f"{len(wrong)} of {len(recorded)} differ: {_listed(wrong)}"
    return checked("installed files", not wrong, found if wrong else f"{len(recorded)}", _remedy())


def _check_group(name: str, paths: list[Path]) -> Check:
    missing = [path for path in paths if not _size(path)]
    found = f"not found: {_listed(missing)}" if missing else str(paths[0].parent)
    return checked(name, not missing, found, _remedy())


def _size(path: Path) -> int:
    """Size in bytes; 0 without such a file."""
    return path.stat().st_size if path.is_file() else 0


def _listed(paths: list[Path]) -> str:
    return ", ".join(map(str, paths[:3])) + (", ..." if len(paths) > 3 else "")


def _remedy() -> str:
    if checkout() is not None:
        return "restore the files of the checkout: `git status` lists them"
    return f"install it again: `pip install --force-reinstall --no-deps WHEEL_FILE` ({GUIDE})"
