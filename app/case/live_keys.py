"""The keys of ``live.yaml``: those of ``case.yaml`` with a live source instead of a recording."""

import re
from dataclasses import replace

from app.case.manifest.cautery import LIVE_CAUTERY
from app.case.manifest.image_keys import LIVE_IMAGES
from app.case.manifest.key_rules import TOPIC, TOPIC_EXPECTED
from app.case.manifest.keys import (
    BY_MATRIX,
    BY_POINTS,
    CASE,
    CLOCK,
    KNOWN_OFFSET,
    REGISTRATION,
)
from app.case.messages.ros_messages import TRACKED_TRANSFORMS_TOPIC
from app.files.keys import (
    Block,
    Boolean,
    Choice,
    Frame,
    Integer,
    Key,
    ListOf,
    Number,
    Text,
    Variant,
)

ABOVE_0 = "every value is more than 0"
PASSIVE = "the force is passive with its period, delay and damping"
NEEDS_ROBOT = "tumor_motion needs a robot or a frame"

_SOURCES = {
    "tf": Block(
        "poses on /tf, without the tracker's status",
        {
            "edges": ListOf(
                "only these transforms; without it those between tool and tumour",
                Block(
                    "a transform",
                    {"parent": Frame("parent frame"), "child": Frame("child frame")},
                ),
                optional=True,
                if_empty="leave it out to use all edges on the topic",
            )
        },
        optional=True,
    ),
    "tracked_transforms": Block(
        "poses with their status, as marginguard_msgs/TrackedTransform",
        {
            "topic": Text(
                "topic of the poses",
                default=TRACKED_TRANSFORMS_TOPIC,
                pattern=TOPIC,
                expected=TOPIC_EXPECTED,
            )
        },
        optional=True,
    ),
    "igtl": Block(
        "poses of an OpenIGTLink server such as PLUS",
        {"host": Text("name or address of the server"), "port": Integer("TCP port", 1, 65_535)},
        optional=True,
    ),
}

SOURCE = Block(
    "where the tracker's poses come from",
    {
        **_SOURCES,
        "clock": Choice(
            "host: stamps are of this machine's clock; estimate: of another one",
            ("host", "estimate"),
        ),
        "latency_ms": Number(
            "delay from the acquisition of a pose to its stamp, for stamps of arrival",
            default=0.0,
            minimum=0.0,
            maximum=1000.0,
        ),
        "sigma_mm": Number(
            "standard deviation of a pose along each axis, slow errors included",
            default=0.0,
            minimum=0.0,
            maximum=100.0,
        ),
        "sigma_deg": Number(
            "standard deviation of a pose about each axis, slow errors included",
            default=0.0,
            minimum=0.0,
            maximum=45.0,
        ),
    },
    variants=tuple(Variant(name, (name,)) for name in _SOURCES),
)

_GUIDANCE = Block(
    "force that guides the hand; default: none",
    {
        "force_n": Number("largest force", minimum=0.0),
        "range_mm": Number("distance over which the force rises", minimum=0.0),
        "rate_n_s": Number("largest rate of change of the force", minimum=0.0),
        "period_ms": Number("interval between forces at the device", minimum=0.0),
        "delay_ms": Number("delay of the loop", minimum=0.0),
        "damping_n_s_m": Number("physical damping of the device", minimum=0.0),
    },
    optional=True,
    rules=(PASSIVE,),
)

_LIMITER = Block(
    "limits of the replies on ~/allowed_twist",
    {
        "tau_ms": Number("time constant of the approach", default=50.0, minimum=0.0),
        "lever_mm": Number("weight of rotation against translation", default=50.0, minimum=0.0),
        "retreat_mm_s": Number(
            "largest speed at which the tool is driven out of the margin",
            default=20.0,
            minimum=0.0,
        ),
        "max_speed_mm_s": Number("largest speed", default=250.0, minimum=0.0),
        "max_turn_rad_s": Number("largest angular speed", default=2.0, minimum=0.0),
        "accept_simulated": Boolean(
            "allow motion by recorded or simulated poses; only where no patient and no robot is",
            default=False,
        ),
    },
    optional=True,
    rules=(ABOVE_0,),
    old_names={"most_mm_s": "max_speed_mm_s", "most_rad_s": "max_turn_rad_s"},
)

_TUMOR_MOTION = Block(
    "expected motion of the tumour; default: it is still",
    {
        "swing_mm": Number("amplitude", minimum=0.0),
        "swing_deg": Number("amplitude of the rotation", minimum=0.0),
        "rate_hz": Number("frequency", minimum=0.0),
        "jitter_mm": Number("standard deviation of the tracker along each axis", minimum=0.0),
        "jitter_deg": Number("standard deviation of the tracker about each axis", minimum=0.0),
        "frame": Frame(
            "measured frame in which the velocity is estimated, at rest beside the robot's base; "
            "default: the reference",
            optional=True,
        ),
    },
    optional=True,
    rules=(ABOVE_0, NEEDS_ROBOT),
)

NODE_NAME = re.compile(r"(/[A-Za-z_][A-Za-z0-9_]*)+")
NODE_NAME_EXPECTED = "a node's name with its namespace, such as /console or /room/console"

_OPERATORS = ListOf(
    "nodes that may call ~/rearm, ~/set_tumor, ~/register and set parameters; a guard against "
    "mistakes, not against attackers; default: every node",
    Text("name of a node", pattern=NODE_NAME, expected=NODE_NAME_EXPECTED),
    optional=True,
    if_empty="leave it out to accept every node",
)

_SECURITY = Choice(
    "required: refuse to start without ROS security (SROS2); optional: as the environment says",
    ("optional", "required"),
    default="optional",
)

LIVE_BLOCKS = {
    "guidance": _GUIDANCE,
    "limiter": _LIMITER,
    "tumor_motion": _TUMOR_MOTION,
}
"""Sections of numbers that ``case.yaml`` does not have."""

ONLY_LIVE: dict[str, Key] = {
    "source": SOURCE,
    **LIVE_BLOCKS,
    "operators": _OPERATORS,
    "security": _SECURITY,
}
"""Keys that ``case.yaml`` does not have."""

_ONLY_RECORDED = ("recording", "images", "cautery", "expected")

_SHARED = {
    **{name: key for name, key in CASE.keys.items() if name not in _ONLY_RECORDED},
    "clock": replace(CLOCK, variants=(KNOWN_OFFSET,)),
    "images": LIVE_IMAGES,
    "cautery": LIVE_CAUTERY,
    "registration": replace(REGISTRATION, variants=(BY_MATRIX, BY_POINTS)),
}

LIVE = replace(CASE, description="a live session", keys={**_SHARED, **ONLY_LIVE})
