"""Reads and checks the sections that ``case.yaml`` and ``live.yaml`` have in common.

Distances are in mm, matrices row by row, times in the unit that ends their key.
"""

import math
from itertools import pairwise
from typing import cast

from app.case.manifest.entries import (
    DEFAULT_BASE_FRAME,
    REFERENCE_FRAME,
    TUMOR_MESH_FRAME,
    ClockEntry,
    ContourEntry,
    Dwell,
    MarginEntry,
    MeshEntry,
    Points,
    Provenance,
    RegistrationEntry,
    RegistrationMethod,
    RobotEntry,
    SegmentationEntry,
    ToolEntry,
    TumorEntry,
)
from app.case.manifest.key_rules import TOPIC, TOPIC_EXPECTED
from app.case.manifest.keys import (
    BY_MATRIX,
    BY_POINT_DWELLS,
    BY_POINTS,
    BY_POSE_DWELLS,
    REGISTRATION,
)
from app.case.tumor import SEGMENTATION_ENDING
from app.files.document import Section
from app.files.keys import Variant
from app.geometry import NS_PER_MS, InputError, MarginGuardError, Transform


def read_provenance(document: Section) -> Provenance:
    """Read ``provenance``."""
    block = document.section("provenance")
    kind = block.choice("kind")
    return Provenance(
        "simulated" if kind == "simulated" else "recorded",
        block.text("source"),
        block.text("licence"),
    )


def read_clock(document: Section) -> ClockEntry:
    """Read ``clock``; without it the joints are on the tracker's clock."""
    if "clock" not in document:
        return ClockEntry(0, estimate=False)
    block = document.section("clock")
    estimate = block.boolean("estimate")
    if estimate and "offset_robot_to_tracker_ms" in block:
        raise InputError(f"{block.place('estimate')} and an offset are given; expected one of them")
    if estimate:
        return ClockEntry(0, estimate=True)
    return ClockEntry(_ns(block, "offset_robot_to_tracker_ms"), estimate=False)


def read_tool(document: Section) -> ToolEntry:
    """Read ``tool``."""
    block = document.section("tool")
    frame = block.frame("frame")
    return ToolEntry(
        frame,
        _tool_mesh(block.section("mesh")) if "mesh" in block else None,
        read_pose(block, "tip_from", target=frame, source=f"{frame}_tip"),
        block.number("sigma_mm"),
    )


def _tool_mesh(block: Section) -> MeshEntry:
    return _mesh(block, repair=block.boolean("repair"))


def read_tumor(document: Section, tool: ToolEntry) -> TumorEntry:
    """Read ``tumor``; `InputError` for one that moves with ``tool``."""
    block = document.section("tumor")
    frame = block.frame("frame")
    if tool.frame == frame:
        raise InputError(
            f"{block.place('frame')} is {frame!r}, the frame of the tool; "
            "expected a frame that does not move with the tool"
        )
    return TumorEntry(
        frame,
        _shape(block),
        read_pose(block, "pose", target=frame, source=TUMOR_MESH_FRAME),
        block.number("sigma_mm"),
    )


def _shape(tumor: Section) -> MeshEntry | SegmentationEntry | ContourEntry:
    if "contour" in tumor:
        if "mesh" in tumor:
            raise InputError(f"{tumor.place('mesh')} and a contour are given; expected one of them")
        return ContourEntry(tumor.section("contour").text("path"))
    mesh = tumor.section("mesh")
    path = mesh.text("path")
    if not path.lower().endswith(SEGMENTATION_ENDING):
        if "segment" in mesh:
            raise InputError(f"{mesh.place('segment')} is given, but {path} is not a segmentation")
        return _mesh(mesh, repair="repair" in mesh and mesh.boolean("repair"))
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
    block = document.section("robot")
    joint_states = block.text("joint_states") if "joint_states" in block else None
    urdf = block.text("urdf")
    xacro_args = block.texts_by_name("xacro_args") if "xacro_args" in block else {}
    if xacro_args and not urdf.lower().endswith(".xacro"):
        raise InputError(f"{block.place('xacro_args')} are given, but {urdf} is not a .xacro file")
    return RobotEntry(
        urdf,
        block.frame("base_frame"),
        block.text("tool_link"),
        joint_states,
        xacro_args,
        block.choice("collision_meshes") == "required",
    )


def read_package_dirs(document: Section) -> dict[str, str]:
    """Read ``package_dirs``: folders as written, by the name of their package."""
    return document.texts_by_name("package_dirs") if "package_dirs" in document else {}


def check_topic(topic: str, where: str) -> str:
    """Return ``topic``, given at ``where``; `InputError` unless it is a full ROS topic name."""
    if not TOPIC.fullmatch(topic):
        raise InputError(f"{where} is {topic!r}; expected {TOPIC_EXPECTED}")
    return topic


def read_registration(document: Section, robot: RobotEntry | None) -> RegistrationEntry | None:
    """Read ``registration``, which is required with a robot."""
    if "registration" not in document:
        if robot is not None:
            raise InputError(
                f"{document.place('registration')} is missing; expected one with a robot"
            )
        return None
    block = document.section("registration")
    variant = _registration_variant(block)
    base = robot.base_frame if robot else DEFAULT_BASE_FRAME
    fixed, moving = _point_pairs(block) if variant is BY_POINTS else ((), ())
    return RegistrationEntry(
        cast(RegistrationMethod, block.choice("method")),
        reference_from_base=_matrix(block, target=REFERENCE_FRAME, source=base)
        if variant is BY_MATRIX
        else None,
        fixed_mm=fixed,
        moving_mm=moving,
        dwells=_dwells(block) if "dwells" in variant.required else (),
        max_drift_mm=block.number("max_drift_mm"),
        max_drift_rad=math.radians(block.number("max_drift_deg")),
        covariance=block.numbers("covariance") if "covariance" in block else None,
        degrees_of_freedom=block.integer("degrees_of_freedom")
        if "degrees_of_freedom" in block
        else None,
    )


def _registration_variant(block: Section) -> Variant:
    """Return the variant that the method and the keys select; `InputError` for a key of another."""
    by_points = BY_POINT_DWELLS if "dwells" in block else BY_POINTS
    variant = {"given": BY_MATRIX, "paired_points": by_points, "robot_world": BY_POSE_DWELLS}[
        block.choice("method")
    ]
    for key in REGISTRATION.others_than(variant):
        if key in block:
            raise InputError(
                f"{block.place(key)} does not belong to {variant.name}; "
                f"expected {', '.join(variant.required)}"
            )
    return variant


def _point_pairs(block: Section) -> tuple[Points, Points]:
    fixed, moving = block.points("fixed_mm"), block.points("moving_mm")
    if len(fixed) != len(moving):
        raise InputError(
            f"{block.place('moving_mm')} has {len(moving)} points; "
            f"expected {len(fixed)} as in fixed_mm"
        )
    return fixed, moving


def _dwells(block: Section) -> tuple[Dwell, ...]:
    dwells = []
    for entry in block.sections("dwells"):
        dwell = Dwell(entry.number("start_s"), entry.number("end_s"))
        if dwell.end_s <= dwell.start_s:
            raise InputError(
                f"{entry.place('end_s')} is {dwell.end_s:g}; "
                f"expected a time after start_s ({dwell.start_s:g})"
            )
        dwells.append(dwell)
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
    block = document.section("margins")
    stop_mm, warn_mm = block.number("stop_mm"), block.number("warn_mm")
    if warn_mm <= stop_mm:
        raise InputError(
            f"{block.place('warn_mm')} is {warn_mm:g}; expected more than stop_mm ({stop_mm:g})"
        )
    return MarginEntry(
        stop_mm,
        warn_mm,
        block.number("k_tre"),
        block.number("v_max_mm_s"),
        _ns(block, "stale_after_ms"),
        block.integer("release_samples"),
        block.number("release_band_mm"),
        _ns(block, "frozen_after_ms"),
    )


def _mesh(block: Section, *, repair: bool = False) -> MeshEntry:
    return MeshEntry(block.text("path"), block.choice("units"), repair)


def read_pose(block: Section, key: str, *, target: str, source: str) -> Transform:
    """Read the pose ``key`` of ``block`` as ``target_from_source``; `InputError` if not rigid."""
    return _matrix(block.section(key), target=target, source=source)


def _matrix(block: Section, *, target: str, source: str) -> Transform:
    numbers = block.numbers("matrix")
    try:
        return Transform.from_matrix(numbers, target=target, source=source)
    except MarginGuardError as error:
        raise InputError(f"{block.place('matrix')}: {error}") from error


def _ns(block: Section, key: str) -> int:
    """Read milliseconds as nanoseconds."""
    return round(block.number(key) * NS_PER_MS)
