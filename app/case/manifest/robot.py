"""The robot and the registration of its base, the same in ``case.yaml`` and in ``live.yaml``."""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Annotated, Literal

from app.case.manifest.key_rules import MATRIX, REFERENCE_FRAME, RIGID, topic_text
from app.files.declared import By, block_of, read_as
from app.files.document import Section
from app.files.keys import (
    ROBOT_FILE,
    XACRO_ARGS,
    Block,
    Choice,
    Frame,
    Integer,
    ListOf,
    Number,
    Numbers,
    Text,
    Texts,
    Variant,
)
from app.geometry import InputError, Transform

DEFAULT_BASE_FRAME = "robot_base"
MIN_DRIFT = 0.1
"""Smallest drift bound, in mm and in degrees: the noise of any tracker exceeds a smaller one."""

Points = tuple[tuple[float, ...], ...]
RegistrationMethod = Literal["given", "paired_points", "robot_world"]


@dataclass(frozen=True, slots=True)
class RobotEntry:
    """The robot that holds the tool. ``joint_states``: topic of its joints, None without any.

    ``require_meshes``: whether a missing collision mesh is an error.
    """

    urdf: Annotated[str, ROBOT_FILE]
    base_frame: Annotated[str, Frame("name of the robot's root in the frame tree")]
    tool_link: Annotated[str, Text("link whose origin is the tip of the tool")]
    joint_states: Annotated[
        str | None,
        topic_text(
            "topic of the joints; without it the robot follows the tool by inverse kinematics",
            optional=True,
        ),
    ]
    xacro_args: Annotated[Mapping[str, str], XACRO_ARGS] = field(default_factory=dict)
    require_meshes: Annotated[
        bool,
        "collision_meshes",
        Choice(
            "required: a missing one is an error; optional: it is left out, with a note, and the "
            "robot is for its kinematics",
            ("required", "optional"),
            default="required",
        ),
        By(lambda robot: robot.choice("collision_meshes") == "required"),
    ] = True

    def check(self, block: Section) -> None:
        """Raise `InputError` for arguments of a file that is no .xacro."""
        if self.xacro_args and not self.urdf.lower().endswith(".xacro"):
            raise InputError(
                f"{block.place('xacro_args')} are given, but {self.urdf} is not a .xacro file"
            )


@dataclass(frozen=True, slots=True)
class Dwell:
    """An interval in which the tool's tip rests on a landmark, in s from the first frame."""

    start_s: Annotated[float, Number("start", minimum=0.0)]
    end_s: Annotated[float, Number("end, after the start")]

    def check(self, block: Section) -> None:
        """Raise `InputError` for an interval without duration."""
        if self.end_s <= self.start_s:
            raise InputError(
                f"{block.place('end_s')} is {self.end_s:g}; "
                f"expected a time after start_s ({self.start_s:g})"
            )


@dataclass(frozen=True, slots=True, eq=False)
class RegistrationEntry:
    """Registration of the robot's base: by a given pose, point pairs or dwells.

    After registration the tool's pose is measured twice, by tracker and robot. A difference of more
    than ``max_drift_mm`` or ``max_drift_rad`` means that the registration no longer holds.
    ``covariance`` (36 numbers, row by row) and ``degrees_of_freedom`` belong to a given pose; None
    where they are not known.
    """

    method: Annotated[
        RegistrationMethod,
        Choice(
            "given: a matrix; paired_points: dwells or points; robot_world: dwells",
            ("given", "paired_points", "robot_world"),
        ),
    ]
    reference_from_base: Annotated[
        Transform | None,
        "matrix",
        Numbers(f"pose of the base in reference: {MATRIX}", 16, optional=True),
        By(lambda block: None),  # `read_registration` knows the frame of the base
    ]
    covariance: Annotated[
        tuple[float, ...] | None,
        Numbers(
            "of the small motion of the base in reference, turn (rad) before shift (mm): 36 "
            "numbers row by row; without it the error is not known",
            36,
            optional=True,
        ),
    ]
    degrees_of_freedom: Annotated[
        int | None,
        Integer("those of the residuals that gave the covariance", 1, 1_000_000, optional=True),
    ]
    fixed_mm: Annotated[
        Points,
        ListOf(
            "points in reference", Numbers("a point", 3), optional=True, if_empty="expected points"
        ),
        By(lambda block: block.value("fixed_mm") or ()),
    ]
    moving_mm: Annotated[
        Points,
        ListOf("the same points in the frame of the base", Numbers("a point", 3), optional=True),
        By(lambda block: block.value("moving_mm") or ()),
    ]
    dwells: Annotated[
        tuple[Dwell, ...],
        ListOf(
            "intervals with the tip at rest on a landmark, from the first frame",
            block_of(Dwell, "an interval", rules=("end_s is after start_s",)),
            optional=True,
            if_empty="expected intervals",
        ),
        By(lambda block: block.value("dwells") or ()),
    ]
    max_drift_mm: Annotated[
        float,
        Number(
            "largest distance between the tool's pose by tracker and by robot",
            default=5.0,
            minimum=MIN_DRIFT,
        ),
    ]
    max_drift_rad: Annotated[
        float,
        Number(
            "largest angle between the tool's pose by tracker and by robot",
            default=3.0,
            minimum=MIN_DRIFT,
        ),
    ]

    def check(self, block: Section) -> None:
        """Raise `InputError` for points that are no pairs, and for dwells that overlap."""
        if len(self.fixed_mm) != len(self.moving_mm):
            raise InputError(
                f"{block.place('moving_mm')} has {len(self.moving_mm)} points; "
                f"expected {len(self.fixed_mm)} as in fixed_mm"
            )
        # A landmark that counts twice would make the registration's uncertainty too small.
        for first, second in pairwise(sorted(self.dwells, key=lambda dwell: dwell.start_s)):
            if second.start_s < first.end_s:
                raise InputError(
                    f"{block.place('dwells')} overlap: {second.start_s:g} to {second.end_s:g} s "
                    f"starts before {first.start_s:g} to {first.end_s:g} s has ended"
                )


BY_MATRIX = Variant(
    "given",
    ("matrix",),
    ("covariance", "degrees_of_freedom"),
    where={"method": {"const": "given"}},
)
BY_POINTS = Variant(
    "paired_points", ("fixed_mm", "moving_mm"), where={"method": {"const": "paired_points"}}
)
BY_POINT_DWELLS = Variant(
    "paired_points by dwells", ("dwells",), where={"method": {"const": "paired_points"}}
)
BY_POSE_DWELLS = Variant("robot_world", ("dwells",), where={"method": {"const": "robot_world"}})

REGISTRATION: Block = block_of(
    RegistrationEntry,
    "how the robot's base is registered to the reference",
    optional=True,
    variants=(BY_MATRIX, BY_POINTS, BY_POINT_DWELLS, BY_POSE_DWELLS),
    rules=(
        RIGID,
        "moving_mm has as many points as fixed_mm",
        "dwells do not overlap",
        "a covariance is symmetric and has no negative variance",
    ),
)

ROBOT = block_of(
    RobotEntry,
    "the robot that holds the tool; without it the tool is held by hand",
    optional=True,
    rules=("xacro_args are given for a .xacro only",),
)

PACKAGE_DIRS = Texts(
    "folders of the packages that package://NAME/... names: absolute or inside the folder of "
    "this file; a --package-dir precedes them",
    re.compile(r"[A-Za-z][A-Za-z0-9_-]*"),
    "the name of a package: letters, digits, '_' and '-'",
    optional=True,
)


def read_registration(document: Section, robot: RobotEntry | None) -> RegistrationEntry | None:
    """Read ``registration``, which is required with a ``robot``, whose base it then places."""
    if "registration" not in document:
        if robot is not None:
            raise InputError(
                f"{document.place('registration')} is missing; expected one with a robot"
            )
        return None
    block = document.section("registration")
    _check_method(block)
    entry = read_as(RegistrationEntry, block)
    if "matrix" not in block:
        return entry
    base = DEFAULT_BASE_FRAME if robot is None else robot.base_frame
    pose = block.matrix("matrix", target=REFERENCE_FRAME, source=base)
    return replace(entry, reference_from_base=pose)


def _check_method(block: Section) -> None:
    """Raise `InputError` for a key of another method, and for a missing one."""
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
    block.require(variant.required)
