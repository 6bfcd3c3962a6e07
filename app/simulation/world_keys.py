"""The keys of ``world.yaml``: what is simulated, and how it is measured."""

import json

from app.files.json_schema import json_schema
from app.files.keys import (
    Block,
    Boolean,
    Choice,
    Frame,
    Integer,
    Key,
    ListOf,
    Number,
    Numbers,
    Text,
)
from app.files.meshes import UNITS_MM
from app.files.robot_keys import ROBOT_FILE, XACRO_ARGS
from app.synthetic.presets import PRESETS

MAX_TIMESTEP_MS = 2.0
"""Contacts and loops are stiff on the scale of two steps: longer ones could not hold them."""

FILES = "the named files exist and have a known format"
UNIQUE_NAMES = "names of robots, tools, bodies and tissues differ from each other"
KNOWN_NAMES = "hand.robot is a robot, towards and tracked name a tool, a body or a tissue"
ORDERED_TIMES = "end_s is after start_s"
ENDS_IN_PERIOD = "period_s is not before the end of the last push"
AXIS_NUMBERS = "axes are integers from 0 to 63 that differ, signs 1 or -1"
PASSIVE = "stiffness_n_m is below damping_n_s_m / (scale^2 (period / 2 + delay))"
_MESH_PATH = "mesh file (.stl, .ply, .obj), relative, absolute or package://NAME/..."

_POSE: dict[str, Key] = {
    "position_mm": Numbers("position; default: the origin", 3, optional=True),
    "rotation_deg": Numbers("axis times angle; default: none", 3, optional=True),
}

_MESH = Block(
    "closed surface in the body's own frame",
    {
        "path": Text(_MESH_PATH),
        "units": Choice("unit of the file's coordinates", tuple(UNITS_MM)),
    },
)

_COLLISION = Choice(
    "hull: the convex hull of each surface; parts: an approximate convex decomposition, computed "
    "once and cached; none: touches nothing",
    ("hull", "parts", "none"),
    default="hull",
)
_FRICTION = Number("coefficient of sliding friction", default=0.3, minimum=0.0, maximum=10.0)

_PHYSICS = Block(
    "the physics engine",
    {
        "timestep_ms": Number("time step", default=1.0, above=0.0, maximum=MAX_TIMESTEP_MS),
        "gravity_mm_s2": Number("along -z of the world", default=9806.65, minimum=0.0),
    },
    optional=True,
)

_TOOL = Block(
    "tool that a link holds",
    {
        "name": Frame("name of the tool"),
        "link": Frame("link that holds it"),
        "mesh": _MESH,
        "mass_kg": Number("mass", above=0.0),
        "friction": _FRICTION,
        "collision": _COLLISION,
        **_POSE,
    },
    optional=True,
)

_ROBOT = Block(
    "a robot; its base link is fixed in the world",
    {
        "name": Frame("name of the robot"),
        "file": ROBOT_FILE,
        "xacro_args": XACRO_ARGS,
        "density_kg_m3": Number(
            "density of the links that the file gives no mass; needed if there are any",
            optional=True,
            above=0.0,
        ),
        "max_effort": Number(
            "limit of the drives that the file gives none, N m or N; needed if there are any",
            optional=True,
            above=0.0,
        ),
        "armature_kg_m2": Number(
            "inertia of each drive's rotor, seen at its joint", default=0.0, minimum=0.0
        ),
        "collision": _COLLISION,
        "self_collision": Boolean(
            "links touch each other, except those that a joint connects", default=False
        ),
        "friction": _FRICTION,
        "positions": ListOf(
            "positions of joints at the start; default 0",
            Block(
                "a joint",
                {
                    "joint": Text("name of an actuated joint"),
                    "position": Number("rad, or m for a sliding joint"),
                },
            ),
            optional=True,
            if_empty="leave it out to start at 0",
        ),
        "tool": _TOOL,
        **_POSE,
    },
)

_BODY = Block(
    "a rigid body",
    {
        "name": Frame("name of the body"),
        "mesh": _MESH,
        "motion": Choice("fixed in the world, or free to move", ("fixed", "free")),
        "mass_kg": Number("mass of a free body; needed for one", optional=True, above=0.0),
        "friction": _FRICTION,
        "collision": _COLLISION,
        **_POSE,
    },
)

_TISSUE = Block(
    "a structure that breathing and shifts of the tissue move; nothing resists it",
    {
        "name": Frame("name of the structure"),
        "mesh": _MESH,
        "breathing": Block(
            "displacement at full inspiration, in the axes of the world",
            {
                "shift_mm": Numbers("translation", 3),
                "turn_deg": Numbers("rotation vector about the structure's own origin", 3),
            },
            optional=True,
        ),
        "shifts": ListOf(
            "smooth displacements that stay, in the axes of the world",
            Block(
                "a displacement",
                {
                    "start_s": Number("start", minimum=0.0),
                    "end_s": Number("end, after the start"),
                    "shift_mm": Numbers("translation", 3),
                },
                rules=(ORDERED_TIMES,),
            ),
            optional=True,
            if_empty="leave it out for none",
        ),
        **_POSE,
    },
)

_BREATHING = Block(
    "breathing of the patient",
    {
        "frequency_hz": Number("breaths per second", default=0.25, above=0.0, maximum=5.0),
        "held_until_s": Number("the breath is held until then", default=0.0, minimum=0.0),
    },
    optional=True,
)


def _tracker_number(description: str, minimum: float, maximum: float) -> Number:
    text = f"{description}; default: that of the model"
    return Number(text, optional=True, minimum=minimum, maximum=maximum)


_TRACKER = Block(
    "the tracker that measures poses; default: none",
    {
        "tracked": ListOf(
            "tools, bodies and tissues that carry a sensor",
            Text("name"),
            if_empty="expected names",
        ),
        "model": Choice(
            "a real tracker, or white: regular times and 0.3 mm and 0.3 degrees of white noise",
            tuple(PRESETS),
            default="white",
        ),
        "rate_hz": _tracker_number("samples per second", 1.0, 250.0),
        "latency_ms": _tracker_number("from acquisition to stamp and arrival", 0.0, 200.0),
        "white_rms_mm": _tracker_number("RMS length of the white error of positions", 0.0, 5.0),
        "white_rms_deg": _tracker_number("RMS angle of the white error of rotations", 0.0, 5.0),
        "slow_rms_mm": _tracker_number("the same of the correlated error", 0.0, 5.0),
        "slow_rms_deg": _tracker_number("the same of the correlated error", 0.0, 5.0),
        "correlation_ms": _tracker_number("correlation time of that error", 1.0, 60_000.0),
    },
    optional=True,
)

_JOY = Block(
    "joystick or 3D mouse (sensor_msgs/Joy), for simulate --hand joy",
    {
        "topic": Text("its topic; default: /joy", optional=True),
        "axes": Numbers("which of its axes, from 0, push along x, y and z of the world", 3),
        "signs": Numbers("1 or -1 for each; default: 1", 3, optional=True),
        "dead": Number("axes shorter than this count as 0", default=0.05, minimum=0.0, maximum=0.9),
    },
    rules=(AXIS_NUMBERS,),
    optional=True,
)

_DEVICE = Block(
    "haptic device with the topics of CRTK, for simulate --hand device: a spring to the tool",
    {
        "namespace": Text("namespace of its measured_cp and servo_cf, such as /touch"),
        "stiffness_n_m": Number("stiffness of the spring at the tool", above=0.0),
        "scale": Number("way of the tool per way of the handle", above=0.0, maximum=100.0),
        "period_ms": Number("period of its forces", minimum=0.5, maximum=20.0),
        "delay_ms": Number("delay from its pose to its force, besides half a period", minimum=0.0),
        "damping_n_s_m": Number("physical damping of its handle", above=0.0),
        "rotation_deg": Numbers(
            "axis times angle from its axes to those of the world; default: none", 3, optional=True
        ),
    },
    rules=(PASSIVE,),
    optional=True,
)

_HAND = Block(
    "hand that pushes a robot's tool; default: none",
    {
        "robot": Text("name of the robot"),
        "force_n": Number("force of a push", default=10.0, above=0.0, maximum=200.0),
        "free_speed_mm_s": Number(
            "speed of the tool under this force where nothing is near", default=100.0, above=0.0
        ),
        "period_s": Number(
            "the pushes repeat after this time; default: they are done once",
            optional=True,
            above=0.0,
        ),
        "pushes": ListOf(
            "pushes, in order of time",
            Block(
                "a push",
                {
                    "start_s": Number("start", minimum=0.0),
                    "end_s": Number("end, after the start"),
                    "towards": Text("the tool, body or tissue whose origin is pushed at"),
                    "retreat": Boolean("away from it instead", default=False),
                },
                rules=(ORDERED_TIMES,),
            ),
            optional=True,
            if_empty="leave it out for none",
        ),
        "joy": _JOY,
        "device": _DEVICE,
    },
    rules=(ENDS_IN_PERIOD,),
    optional=True,
)

WORLD = Block(
    "a simulated world",
    {
        "schema": Integer("version of the format", 1, 1),
        "name": Text("name of the world, shown in reports"),
        "seed": Integer("of all random numbers", 0, 2**32 - 1),
        "physics": _PHYSICS,
        "robots": ListOf("robots", _ROBOT, optional=True, if_empty="leave it out for none"),
        "bodies": ListOf("bodies", _BODY, optional=True, if_empty="leave it out for none"),
        "tissues": ListOf("soft tissue", _TISSUE, optional=True, if_empty="leave it out for none"),
        "breathing": _BREATHING,
        "tracker": _TRACKER,
        "hand": _HAND,
    },
    rules=(FILES, UNIQUE_NAMES, KNOWN_NAMES),
)


def world_schema_text() -> str:
    """Return the JSON Schema of ``world.yaml``, as indented JSON."""
    schema = json_schema(WORLD, "world.yaml of MarginGuard, schema 1")
    return json.dumps(schema, indent=2) + "\n"
