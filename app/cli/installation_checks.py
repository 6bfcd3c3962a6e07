"""Checks of this installation and of the files that it ships, each with a remedy.

Nothing heavy is imported into this process: packages are looked up in their metadata, and imports
are tried in another process, so that a crash is a result like any other.
"""

import os
import re
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from importlib import metadata
from importlib.resources import files
from pathlib import Path

from app.cli.system_checks import Check, check_building, check_machine, checked
from app.files.child_process import ChildError, run_to_end
from app.files.extras import DISTRIBUTION, GUIDE, install_command, install_interfaces
from app.files.paths import checkout, shipped, state_folder

PROBE_TIMEOUT_S = 60.0
EXTRAS = ("", "ros", "scene")

_STATE = "live sessions"
_STATE_REMEDY = "a live session cannot start: make the folder writable, or set XDG_STATE_HOME"

RCLPY = "import rclpy; print(rclpy.__file__)"
INTERFACES = """\
import marginguard_msgs.msg, tf2_msgs.msg
from rclpy.type_support import check_for_type_support
check_for_type_support(marginguard_msgs.msg.FixtureConstraint)
check_for_type_support(tf2_msgs.msg.TFMessage)
from app.bridge.message_definitions import check_installed
check_installed()
print(tf2_msgs.__file__)
"""
MRML = """\
import slicer
scene = slicer.vtkMRMLScene()
print(scene.AddNewNodeByClass("vtkMRMLLinearTransformNode").GetClassName())
"""

Probe = Callable[[str], tuple[bool, str]]
"""Runs Python code in another process; returns success and the last line of its output."""


def run_probe(code: str) -> tuple[bool, str]:
    """`Probe` that runs ``code`` with this Python in a process of its own."""
    try:
        done = run_to_end([sys.executable, "-P", "-c", code], PROBE_TIMEOUT_S)
    except ChildError as problem:
        return False, str(problem)
    printed = done.stdout if done.returncode == 0 else done.stderr
    lines = printed.decode(errors="replace").strip().splitlines()
    if done.returncode < 0:
        lines.append(f"killed by signal {-done.returncode}")
    return done.returncode == 0, lines[-1].strip() if lines else f"exit status {done.returncode}"


def check_environment(probe: Probe = run_probe) -> list[Check]:
    """Run every check, in the order in which remedies apply: machine, packages, ROS, Slicer.

    A compiler is needed only in a checkout, where the messages are compiled.
    """
    with ThreadPoolExecutor() as pool:
        probed = [
            pool.submit(check, probe) for check in (check_rclpy, check_interfaces, check_mrml)
        ]
        return [
            *check_machine(),
            *(check_building() if checkout() else ()),
            *check_packages(),
            *check_shipped(),
            check_state(state_folder()),
            *(future.result() for future in probed),
        ]


def check_packages(distribution: str = DISTRIBUTION) -> list[Check]:
    """One check for each requirement of ``distribution``, except those of its tests."""
    try:
        requirements = metadata.requires(distribution) or []
    except metadata.PackageNotFoundError:
        return [Check(distribution, False, "not installed", f"run `{install_command()}`")]
    checks = []
    for requirement in requirements:
        name, extra = _parse_requirement(requirement)
        if extra not in EXTRAS:
            continue
        try:
            checks.append(checked(name, True, metadata.version(name), ""))
        except metadata.PackageNotFoundError:
            remedy = f"run `{install_command(extra)}`"
            checks.append(Check(name, False, "not installed", remedy))
    return checks


def check_rclpy(probe: Probe) -> Check:
    """Check that ROS 2 can be imported."""
    ok, output = probe(RCLPY)
    remedy = f"source a ROS 2 Jazzy, or run `{install_command('ros')}`"
    return checked("rclpy imports", ok, output, f"{remedy}; --no-ros works without")


def check_interfaces(probe: Probe) -> Check:
    """Check that the compiled messages load, and report which ``tf2_msgs`` is used.

    A sourced ROS 2 precedes the environment on Python's path, so its package wins.
    """
    ok, output = probe(INTERFACES)
    found = f"tf2_msgs {_origin(Path(output))}" if ok else output
    return checked("ROS interfaces", ok, found, install_interfaces())


def check_mrml(probe: Probe) -> Check:
    """Check that a scene of 3D Slicer can be created."""
    ok, output = probe(MRML)
    remedy = f"run `{install_command('scene')}`"
    return checked("3D Slicer scene", ok, "MRML" if ok else output, remedy)


def check_state(folder: Path) -> Check:
    """Check that records can be written to ``folder``; list its holds and sessions.

    A hold is no error: it is there to be seen by the next session and its operator.
    """
    if not _is_writable(folder):
        return checked(_STATE, False, f"{folder} cannot be written", _STATE_REMEDY)
    texts = [_record_text(path) for path in sorted(folder.glob("domain*.json"))]
    found = [text for text in texts if text]
    return checked(_STATE, True, "; ".join([str(folder), *found]), "")


def _is_writable(folder: Path) -> bool:
    existing = next((each for each in (folder, *folder.parents) if os.path.lexists(each)), None)
    return existing is not None and existing.is_dir() and os.access(existing, os.W_OK | os.X_OK)


def _record_text(path: Path) -> str:
    """The effect of this record on the next session; empty if it may start without hold."""
    from app.hold import SecondInstanceError, StateFileError
    from app.hold.on_disk import check_no_guard
    from app.hold.record import causes_of_record, read_any_record

    try:
        record = read_any_record(path)
    except StateFileError as error:
        return f"{error}: the next session begins on hold"
    slot = next((slot for slot in record.key.slots if slot.stem == path.stem), None)
    if slot is None:
        return f"{path.name}: not the record of its name: the next session begins on hold"
    try:
        check_no_guard(path.with_suffix(".lock"), slot)
    except SecondInstanceError:
        return f"{slot}: a session runs (process {record.pid})"
    causes = causes_of_record(record, None)
    return f"{slot}: the next session begins on hold ({causes[0]})" if causes else ""


def _origin(module: Path) -> str:
    try:
        ours = Path(str(metadata.distribution("marginguard-interfaces").locate_file("")))
    except metadata.PackageNotFoundError:
        return f"of {module.parent}"
    if module.resolve().is_relative_to(ours.resolve()):
        return "built by marginguard-interfaces"
    return f"of {module.parent}, ahead of the one built by marginguard-interfaces"


def _parse_requirement(requirement: str) -> tuple[str, str]:
    """Project name and extra ("" for none) of a Requires-Dist value."""
    name = re.match(r"[A-Za-z0-9._-]+", requirement)
    if name is None:
        raise ValueError(f"{requirement!r} does not start with a project name")
    extra = re.search(r"""extra\s*==\s*['"]([^'"]+)['"]""", requirement)
    return name.group(), extra.group(1) if extra else ""


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
    "world.css", "world.js", "plan.css",
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
