"""The keys of ``case.yaml``, and those that ``live.yaml`` has in common with it."""

import re

from app.case.manifest.cautery import CAUTERY
from app.case.manifest.image_keys import IMAGES
from app.case.manifest.key_rules import MATRIX, RIGID, TOPIC, TOPIC_EXPECTED
from app.case.manifest.needle_keys import NEEDLE
from app.case.manifest.plausibility_keys import PLAUSIBILITY
from app.case.manifest.stylus_keys import STYLUS
from app.case.tumor import SEGMENTATION_ENDING
from app.files.keys import (
    Block,
    Boolean,
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
from app.files.meshes import UNITS_MM
from app.files.robot_keys import ROBOT_FILE, XACRO_ARGS

MIN_DRIFT = 0.1
"""Smallest drift bound, in mm and in degrees: the noise of any tracker exceeds a smaller one."""

_YEAR_MS = 365 * 86_400_000
MAX_RATE_HZ = 20_000.0

FILES = (
    "the named files exist, in the folder of this file or of a package or by an absolute path, "
    "have a known format, and a sha256 is that of its file"
)
SESSION_LIMITS = (
    "a session accepts stop_mm up to 100, warn_mm up to 200, k_tre up to 10, "
    "v_max_mm_s up to 1000, stale_after_ms up to 10000, release_samples up to 1000, "
    "release_band_mm up to 10, frozen_after_ms up to 60000"
)
OWN_BASE_FRAME = "robot.base_frame is the name of no other frame"
MESH_PATH = "mesh file (.stl, .ply, .obj), relative, absolute or package://NAME/..."

_SCHEMA = Integer("version of the format", 1, 1)
_NAME = Text("name of the case, shown in reports")

_PROVENANCE = Block(
    "origin of the data",
    {
        "kind": Choice("simulated or recorded data", ("simulated", "recorded")),
        "source": Text("where the data come from"),
        "licence": Text("licence of the data"),
    },
)

_RECORDING = Block(
    "the recorded tracking data",
    {
        "path": Text("a file or folder in one of the formats of docs/formats.md"),
        "sha256": Text(
            "SHA-256 of the file, checked when given",
            optional=True,
            pattern=re.compile(r"[0-9A-Fa-f]{64}"),
            expected="64 hexadecimal digits",
        ),
        "rate_hz": Number(
            "rate of a recording without times; expected only there",
            optional=True,
            above=0.0,
            maximum=MAX_RATE_HZ,
        ),
    },
)

KNOWN_OFFSET = Variant(
    "known offset", ("offset_robot_to_tracker_ms",), where={"estimate": {"const": False}}
)
CLOCK = Block(
    "clock of the robot's joints; by default that of the tracker",
    {
        "offset_robot_to_tracker_ms": Number(
            "tracker time minus robot time", optional=True, minimum=-_YEAR_MS, maximum=_YEAR_MS
        ),
        "estimate": Boolean("estimate the offset from the recorded motion", default=False),
    },
    optional=True,
    variants=(
        KNOWN_OFFSET,
        Variant("estimated offset", ("estimate",), where={"estimate": {"const": True}}),
    ),
)

_TOOL = Block(
    "the tracked tool",
    {
        "frame": Frame("the tracked frame"),
        "mesh": Block(
            "closed surface in the frame of the tip; only a replay with --tip-only needs none",
            {
                "path": Text(MESH_PATH),
                "units": Choice("unit of the file's coordinates", tuple(UNITS_MM)),
                "repair": Boolean(
                    "repair faults of the mesh where that is safe, unite overlapping parts",
                    default=False,
                ),
            },
            optional=True,
        ),
        "tip_from": Block(
            "pose of the tip in the tracked frame",
            {"matrix": Numbers(MATRIX, 16)},
            rules=(RIGID,),
        ),
        "sigma_mm": Number(
            "standard deviation of the tip in its worst direction, added to that of the "
            "registration",
            default=0.0,
            minimum=0.0,
            maximum=10.0,
        ),
    },
)

_SEGMENTATION = "".join(
    f"[{letter}{letter.upper()}]" if letter.isalpha() else re.escape(letter)
    for letter in SEGMENTATION_ENDING
)
_IS_SEGMENTATION = {"type": "string", "pattern": rf"{_SEGMENTATION}$(?!\n)"}

_TUMOR = Block(
    "the tumour",
    {
        "frame": Frame("the tracked frame that the tumour moves with"),
        "mesh": Block(
            "a mesh file with units, or a segmentation",
            {
                "path": Text(f"{MESH_PATH}, or a segmentation ({SEGMENTATION_ENDING})"),
                "units": Choice(
                    "unit of the mesh file's coordinates", tuple(UNITS_MM), optional=True
                ),
                "repair": Boolean(
                    "repair faults of the mesh where that is safe; default false", optional=True
                ),
                "segment": Text(
                    "name, ID or label value of the segment; needed if there are several",
                    optional=True,
                ),
            },
            optional=True,
            variants=(
                Variant("mesh file", ("units",), ("repair",), {"path": {"not": _IS_SEGMENTATION}}),
                Variant("segmentation", optional=("segment",), where={"path": _IS_SEGMENTATION}),
            ),
        ),
        "contour": Block(
            "points on the tumour's surface; the tumour is their convex hull, rounded outward",
            {"path": Text(".mrk.json, .fcsv or .yaml, relative, absolute or package://NAME/...")},
            optional=True,
        ),
        "pose": Block(
            "pose of the tumour's coordinates in its frame",
            {"matrix": Numbers(MATRIX, 16)},
            rules=(RIGID,),
        ),
        "sigma_mm": Number(
            "standard deviation of the surface along its normal, added to that of the registration",
            default=0.0,
            minimum=0.0,
            maximum=10.0,
        ),
    },
    variants=(Variant("mesh or segmentation", ("mesh",)), Variant("contour", ("contour",))),
)

_ROBOT = Block(
    "the robot that holds the tool; without it the tool is held by hand",
    {
        "urdf": ROBOT_FILE,
        "base_frame": Frame("name of the robot's root in the frame tree"),
        "tool_link": Text("link whose origin is the tip of the tool"),
        "joint_states": Text(
            "topic of the joints; without it the robot follows the tool by inverse kinematics",
            optional=True,
            pattern=TOPIC,
            expected=TOPIC_EXPECTED,
        ),
        "xacro_args": XACRO_ARGS,
        "collision_meshes": Choice(
            "required: a missing one is an error; optional: it is left out, with a note, and the "
            "robot is for its kinematics",
            ("required", "optional"),
            default="required",
        ),
    },
    optional=True,
    rules=("xacro_args are given for a .xacro only",),
)

_PACKAGE_DIRS = Texts(
    "folders of the packages that package://NAME/... names: absolute or inside the folder of this "
    "file; a --package-dir precedes them",
    re.compile(r"[A-Za-z][A-Za-z0-9_-]*"),
    "the name of a package: letters, digits, '_' and '-'",
    optional=True,
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

REGISTRATION = Block(
    "how the robot's base is registered to the reference",
    {
        "method": Choice(
            "given: a matrix; paired_points: dwells or points; robot_world: dwells",
            ("given", "paired_points", "robot_world"),
        ),
        "matrix": Numbers(f"pose of the base in reference: {MATRIX}", 16, optional=True),
        "covariance": Numbers(
            "of the small motion of the base in reference, turn (rad) before shift (mm): 36 "
            "numbers row by row; without it the error is not known",
            36,
            optional=True,
        ),
        "degrees_of_freedom": Integer(
            "those of the residuals that gave the covariance", 1, 1_000_000, optional=True
        ),
        "fixed_mm": ListOf(
            "points in reference",
            Numbers("a point", 3),
            optional=True,
            if_empty="expected points",
        ),
        "moving_mm": ListOf(
            "the same points in the frame of the base", Numbers("a point", 3), optional=True
        ),
        "dwells": ListOf(
            "intervals with the tip at rest on a landmark, from the first frame",
            Block(
                "an interval",
                {
                    "start_s": Number("start", minimum=0.0),
                    "end_s": Number("end, after the start"),
                },
                rules=("end_s is after start_s",),
            ),
            optional=True,
            if_empty="expected intervals",
        ),
        "max_drift_mm": Number(
            "largest distance between the tool's pose by tracker and by robot",
            default=5.0,
            minimum=MIN_DRIFT,
        ),
        "max_drift_deg": Number(
            "largest angle between the tool's pose by tracker and by robot",
            default=3.0,
            minimum=MIN_DRIFT,
        ),
    },
    optional=True,
    variants=(BY_MATRIX, BY_POINTS, BY_POINT_DWELLS, BY_POSE_DWELLS),
    rules=(
        RIGID,
        "moving_mm has as many points as fixed_mm",
        "dwells do not overlap",
        "a covariance is symmetric and has no negative variance",
    ),
)

_MARGINS = Block(
    "margins of the fixture, and the age at which data are stale",
    {
        "stop_mm": Number("the constraint acts from here", minimum=0.0),
        "warn_mm": Number("WARNING from here; more than stop_mm", minimum=0.0),
        "k_tre": Number(
            "multiples of the registration's sigma that are added to both", minimum=0.0
        ),
        "v_max_mm_s": Number(
            "multiplied by the age of the oldest sample and added to both", minimum=0.0
        ),
        "stale_after_ms": Number("maximum age of a sample", above=0.0, maximum=_YEAR_MS),
        "release_samples": Integer(
            "number of better samples before a better state is entered", 1, default=3
        ),
        "release_band_mm": Number(
            "by how much these must be beyond the boundary", default=0.5, minimum=0.0
        ),
        "frozen_after_ms": Number(
            "a pose that is constant for longer is frozen",
            default=1000.0,
            above=0.0,
            maximum=_YEAR_MS,
        ),
    },
    rules=("warn_mm is more than stop_mm", SESSION_LIMITS),
)

CASE = Block(
    "a recorded case",
    {
        "schema": _SCHEMA,
        "name": _NAME,
        "provenance": _PROVENANCE,
        "recording": _RECORDING,
        "images": IMAGES,
        "cautery": CAUTERY,
        "clock": CLOCK,
        "tool": _TOOL,
        "tumor": _TUMOR,
        "needle": NEEDLE,
        "stylus": STYLUS,
        "robot": _ROBOT,
        "package_dirs": _PACKAGE_DIRS,
        "registration": REGISTRATION,
        "margins": _MARGINS,
        "plausibility": PLAUSIBILITY,
        "expected": Text("file of the expected results: expected.yaml", optional=True),
    },
    needs=(("robot", "registration"),),
    rules=(FILES, "tumor.frame is not the frame of the tool", OWN_BASE_FRAME),
)
