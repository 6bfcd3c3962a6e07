"""Reads and checks the sections that ``case.yaml`` and ``live.yaml`` have in common.

Distances are in mm, matrices row by row, times in the unit that ends their key.
"""

import math
import re
from dataclasses import replace
from itertools import pairwise

from app.case.manifest.entries import (
    DEFAULT_BASE_FRAME,
    REFERENCE_FRAME,
    TUMOR_MESH_FRAME,
    ClockEntry,
    ContourEntry,
    Dwell,
    MarginEntry,
    MeshEntry,
    Provenance,
    RegistrationEntry,
    RobotEntry,
    SegmentationEntry,
    ToolEntry,
    TumorEntry,
)
from app.case.tumor import SEGMENTATION_ENDING
from app.files.document import Section
from app.files.meshes import UNITS_MM
from app.geometry import (
    NS_PER_MS,
    FrameError,
    InputError,
    MarginGuardError,
    Transform,
    check_frame,
)

_TOPIC = re.compile(r"(/[A-Za-z_][A-Za-z0-9_]*)+")

MIN_DRIFT = 0.1
"""Smallest drift bound, in mm and in degrees: the noise of any tracker exceeds a smaller one."""


def check_schema(document: Section) -> None:
    """Raise `InputError` unless the document has schema 1."""
    schema = document.integer("schema", minimum=1)
    if schema != 1:
        raise InputError(f"{document.place('schema')} is {schema}; expected 1")


def read_provenance(document: Section) -> Provenance:
    """Read ``provenance``."""
    block = document.section("provenance", ("kind", "source", "licence"))
    kind = block.choice("kind", ("simulated", "recorded"))
    return Provenance(
        "simulated" if kind == "simulated" else "recorded",
        block.text("source"),
        block.text("licence"),
    )


def read_clock(document: Section) -> ClockEntry:
    """Read ``clock``; without it the joints are on the tracker's clock."""
    if "clock" not in document:
        return ClockEntry(0, estimate=False)
    block = document.section("clock", ("offset_robot_to_tracker_ms", "estimate"))
    estimate = block.boolean("estimate") if "estimate" in block else False
    if estimate and "offset_robot_to_tracker_ms" in block:
        raise InputError(f"{block.place('estimate')} and an offset are given; expected one of them")
    if estimate:
        return ClockEntry(0, estimate=True)
    return ClockEntry(_ns(block, "offset_robot_to_tracker_ms", signed=True), estimate=False)


def read_tool(document: Section) -> ToolEntry:
    """Read ``tool``."""
    block = document.section("tool", ("frame", "mesh", "tip_from"))
    frame = read_frame(block, "frame")
    return ToolEntry(
        frame,
        _mesh(block) if "mesh" in block else None,
        _pose(block, "tip_from", target=frame, source=f"{frame}_tip"),
    )


def read_tumor(document: Section, tool: ToolEntry) -> TumorEntry:
    """Read ``tumor``; `InputError` for one that moves with ``tool``."""
    block = document.section("tumor", ("frame", "mesh", "contour", "pose"))
    frame = read_frame(block, "frame")
    if tool.frame == frame:
        raise InputError(
            f"{block.place('frame')} is {frame!r}, the frame of the tool; "
            "expected a frame that does not move with the tool"
        )
    return TumorEntry(
        frame, _shape(block), _pose(block, "pose", target=frame, source=TUMOR_MESH_FRAME)
    )


def _shape(tumor: Section) -> MeshEntry | SegmentationEntry | ContourEntry:
    if "contour" in tumor:
        if "mesh" in tumor:
            raise InputError(f"{tumor.place('mesh')} and a contour are given; expected one of them")
        return ContourEntry(tumor.section("contour", ("path",)).text("path"))
    mesh = tumor.section("mesh", ("path", "units", "repair", "segment"))
    path = mesh.text("path")
    if not path.lower().endswith(SEGMENTATION_ENDING):
        if "segment" in mesh:
            raise InputError(f"{mesh.place('segment')} is given, but {path} is not a segmentation")
        return MeshEntry(
            path,
            mesh.choice("units", tuple(UNITS_MM)),
            repair="repair" in mesh and mesh.boolean("repair"),
        )
    if "repair" in mesh:
        raise InputError(
            f"{mesh.place('repair')} is given for a segmentation; only mesh files are repaired"
        )
    if "units" in mesh:
        raise InputError(
            f"{mesh.place('units')} is given for a segmentation; its unit is always mm"
        )
    return SegmentationEntry(path, mesh.text("segment") if "segment" in mesh else None)


def read_robot(document: Section) -> RobotEntry | None:
    """Read ``robot``; None where the tool is held by hand."""
    if "robot" not in document:
        return None
    block = document.section("robot", ("urdf", "base_frame", "tool_link", "joint_states"))
    joint_states = read_topic(block, "joint_states") if "joint_states" in block else None
    return RobotEntry(
        block.text("urdf"), read_frame(block, "base_frame"), block.text("tool_link"), joint_states
    )


def read_topic(block: Section, key: str) -> str:
    """Read the full name of a ROS topic."""
    return check_topic(block.text(key), block.place(key))


def check_topic(topic: str, where: str) -> str:
    """Return ``topic``, given at ``where``; `InputError` unless it is a full ROS topic name."""
    if not _TOPIC.fullmatch(topic):
        raise InputError(
            f"{where} is {topic!r}; expected a topic that begins with '/', of letters, digits and "
            "underscores"
        )
    return topic


def read_registration(document: Section, robot: RobotEntry | None) -> RegistrationEntry | None:
    """Read ``registration``, which is required with a robot."""
    if "registration" not in document:
        if robot is not None:
            raise InputError(
                f"{document.place('registration')} is missing; expected one with a robot"
            )
        return None
    drift = ("max_drift_mm", "max_drift_deg")
    block = document.section(
        "registration", ("method", "matrix", "fixed_mm", "moving_mm", "dwells", *drift)
    )
    entry = _registration_method(block, robot)
    if "max_drift_mm" in block:
        entry = replace(entry, max_drift_mm=block.number("max_drift_mm", minimum=MIN_DRIFT))
    if "max_drift_deg" in block:
        bound_deg = block.number("max_drift_deg", minimum=MIN_DRIFT)
        entry = replace(entry, max_drift_rad=math.radians(bound_deg))
    return entry


def _registration_method(block: Section, robot: RobotEntry | None) -> RegistrationEntry:
    method = block.choice("method", ("given", "paired_points", "robot_world"))
    if method == "given":
        _allow_only(block, method, ("matrix",))
        base = robot.base_frame if robot else DEFAULT_BASE_FRAME
        pose = _matrix(block, target=REFERENCE_FRAME, source=base)
        return RegistrationEntry("given", reference_from_base=pose)
    if method == "robot_world":
        _allow_only(block, method, ("dwells",))
        return RegistrationEntry("robot_world", dwells=_dwells(block))
    if "dwells" in block:
        _allow_only(block, "paired_points by dwells", ("dwells",))
        return RegistrationEntry("paired_points", dwells=_dwells(block))
    _allow_only(block, method, ("fixed_mm", "moving_mm"))
    fixed, moving = block.points("fixed_mm"), block.points("moving_mm")
    if not fixed:
        raise InputError(f"{block.place('fixed_mm')} is empty; expected points")
    if len(fixed) != len(moving):
        raise InputError(
            f"{block.place('moving_mm')} has {len(moving)} points; "
            f"expected {len(fixed)} as in fixed_mm"
        )
    return RegistrationEntry("paired_points", fixed_mm=fixed, moving_mm=moving)


def _dwells(block: Section) -> tuple[Dwell, ...]:
    dwells = []
    for entry in block.sections("dwells", ("start_s", "end_s")):
        dwell = Dwell(entry.number("start_s", minimum=0.0), entry.number("end_s"))
        if dwell.end_s <= dwell.start_s:
            raise InputError(
                f"{entry.place('end_s')} is {dwell.end_s:g}; "
                f"expected a time after start_s ({dwell.start_s:g})"
            )
        dwells.append(dwell)
    if not dwells:
        raise InputError(f"{block.place('dwells')} is empty; expected intervals")
    # A landmark that counts twice would make the registration's uncertainty too small.
    for first, second in pairwise(sorted(dwells, key=lambda dwell: dwell.start_s)):
        if second.start_s < first.end_s:
            raise InputError(
                f"{block.place('dwells')} overlap: {second.start_s:g} to {second.end_s:g} s starts "
                f"before {first.start_s:g} to {first.end_s:g} s has ended"
            )
    return tuple(dwells)


def read_margins(document: Section) -> MarginEntry:
    """Read ``margins``."""
    block = document.section(
        "margins",
        (
            "stop_mm",
            "warn_mm",
            "k_tre",
            "v_max_mm_s",
            "stale_after_ms",
            "release_samples",
            "release_band_mm",
            "frozen_after_ms",
        ),
    )
    stop_mm, warn_mm = (block.number(key, minimum=0.0) for key in ("stop_mm", "warn_mm"))
    if warn_mm <= stop_mm:
        raise InputError(
            f"{block.place('warn_mm')} is {warn_mm:g}; expected more than stop_mm ({stop_mm:g})"
        )
    entry = MarginEntry(
        stop_mm,
        warn_mm,
        block.number("k_tre", minimum=0.0),
        block.number("v_max_mm_s", minimum=0.0),
        _ns(block, "stale_after_ms"),
    )
    return MarginEntry(
        entry.stop_mm,
        entry.warn_mm,
        entry.k_tre,
        entry.v_max_mm_s,
        entry.stale_after_ns,
        block.integer("release_samples", minimum=1)
        if "release_samples" in block
        else entry.release_samples,
        block.number("release_band_mm", minimum=0.0)
        if "release_band_mm" in block
        else entry.release_band_mm,
        _ns(block, "frozen_after_ms") if "frozen_after_ms" in block else entry.frozen_after_ns,
    )


def _mesh(block: Section) -> MeshEntry:
    mesh = block.section("mesh", ("path", "units"))
    return MeshEntry(mesh.text("path"), mesh.choice("units", tuple(UNITS_MM)))


def _pose(block: Section, key: str, *, target: str, source: str) -> Transform:
    return _matrix(block.section(key, ("matrix",)), target=target, source=source)


def _matrix(block: Section, *, target: str, source: str) -> Transform:
    numbers = block.numbers("matrix", 16)
    try:
        return Transform.from_matrix(numbers, target=target, source=source)
    except MarginGuardError as error:
        raise InputError(f"{block.place('matrix')}: {error}") from error


def read_frame(block: Section, key: str) -> str:
    """Read the name of a frame."""
    name = block.text(key)
    try:
        return check_frame(name)
    except FrameError as error:
        raise InputError(f"{block.place(key)}: {error}") from error


def _ns(block: Section, key: str, *, signed: bool = False) -> int:
    """Read milliseconds as nanoseconds; positive unless ``signed``, and a year at most."""
    milliseconds = block.number(key)
    year_ms = 365 * 86_400_000
    if abs(milliseconds) > year_ms or (milliseconds <= 0.0 and not signed):
        lowest = f"{-year_ms}" if signed else "more than 0"
        raise InputError(
            f"{block.place(key)} is {milliseconds:g}; expected {lowest} to {year_ms} ms"
        )
    return round(milliseconds * NS_PER_MS)


def _allow_only(block: Section, method: str, allowed: tuple[str, ...]) -> None:
    for key in ("matrix", "fixed_mm", "moving_mm", "dwells"):
        if key in block and key not in allowed:
            raise InputError(
                f"{block.place(key)} does not belong to {method}; expected {', '.join(allowed)}"
            )
