"""The keys of ``plausibility`` in ``case.yaml`` and ``live.yaml``."""

from app.case.manifest.key_rules import MATRIX, RIGID
from app.files.keys import Block, Frame, ListOf, Number, Numbers, Variant

TWO_FRAMES = "parent and child are two frames"
NO_DIRECTION = "a direction and an axis have a length above 0"
BOX = "every value of max_mm is more than that of min_mm"

_MOTION = Block(
    "largest motion of a sensor on a held tool or on the patient; beyond it a pose is not used",
    {
        "max_speed_mm_s": Number("speed", default=2_000.0, above=0.0),
        "max_acceleration_mm_s2": Number("acceleration", default=16_000.0, above=0.0),
        "max_speed_deg_s": Number("angular speed", default=1_200.0, above=0.0),
        "max_acceleration_deg_s2": Number("angular acceleration", default=15_000.0, above=0.0),
    },
    optional=True,
)

ENVELOPE = Variant("envelope", ("max_mm", "max_deg"), ("pose",))
LENGTH = Variant("distance", ("distance_mm", "tolerance_mm"))

_PAIR = Block(
    "two tracked frames whose relative pose hardly changes",
    {
        "parent": Frame("one of the frames"),
        "child": Frame("the other one"),
        "max_mm": Number("largest displacement by breath", optional=True, above=0.0),
        "max_deg": Number("largest rotation of the child", optional=True, above=0.0, maximum=180.0),
        "pose": Block(
            "pose of the child in the parent; by default the mean of the first 5 s",
            {"matrix": Numbers(MATRIX, 16)},
            optional=True,
            rules=(RIGID,),
        ),
        "distance_mm": Number("distance of the two origins", optional=True, minimum=0.0),
        "tolerance_mm": Number("largest difference from it", optional=True, above=0.0),
    },
    variants=(ENVELOPE, LENGTH),
    rules=(TWO_FRAMES,),
)

SPHERE = Variant("sphere", ("center_mm", "radius_mm"))
CUBOID = Variant("box", ("min_mm", "max_mm"))

_WORKSPACE = Block(
    "region that the tip of the tool never leaves, in a tracked frame or the base of the robot",
    {
        "frame": Frame("frame of the region"),
        "center_mm": Numbers("centre of a sphere", 3, optional=True),
        "radius_mm": Number("its radius", optional=True, above=0.0),
        "min_mm": Numbers("smallest x, y, z of a box", 3, optional=True),
        "max_mm": Numbers("largest x, y, z of a box", 3, optional=True),
    },
    optional=True,
    variants=(SPHERE, CUBOID),
    rules=(BOX,),
)

_APPROACH = Block(
    "cone of directions of the tool: about gravity, or about the planned approach",
    {
        "frame": Frame("tracked frame of the direction, or the base of the robot"),
        "direction": Numbers("axis of the cone in that frame", 3),
        "axis": Numbers("axis of the tool, in the frame of its tip", 3),
        "max_deg": Number("largest angle between them", above=0.0, maximum=180.0),
    },
    optional=True,
    rules=(NO_DIRECTION,),
)

PLAUSIBILITY = Block(
    "limits and relations by which a wrong pose is found",
    {
        "motion": _MOTION,
        "mean_drift_mm": Number(
            "largest mean difference, over about 0.25 s, between the tool's position by tracker "
            "and by robot; default: half of registration.max_drift_mm",
            optional=True,
            above=0.0,
        ),
        "pairs": ListOf("relations of two tracked frames", _PAIR, optional=True),
        "workspace": _WORKSPACE,
        "approach": _APPROACH,
    },
    optional=True,
)
