"""The keys of ``control.yaml``: the arm, its tool, and where its base is."""

import json

from app.files.json_schema import json_schema
from app.files.keys import (
    Block,
    Boolean,
    Choice,
    Frame,
    Integer,
    Key,
    Number,
    Numbers,
    Text,
)
from app.files.robot_keys import ROBOT_FILE, XACRO_ARGS

FILES = "the robot's file exists and has a known format"
PASSIVE = "stiffness_n_m times half the period plus damping_n_s_m is below arm_damping_n_s_m"

_MATRIX = Numbers("4 x 4 matrix, row by row, translation in mm", 16)

_ROBOT = Block(
    "the arm",
    {
        "file": ROBOT_FILE,
        "xacro_args": XACRO_ARGS,
        "max_joint_speed": Number(
            "limit of the joints that the file gives none, rad/s or m/s; needed if there are any",
            optional=True,
            above=0.0,
        ),
    },
)

_TOOL: dict[str, Key] = {
    "link": Frame("link that holds it"),
    "position_mm": Numbers("the tool's tip in the link", 3),
    "rotation_deg": Numbers("axis times angle; default: none", 3, optional=True),
}

_BASE = Block(
    "the registration of the arm's base, used where the guard publishes none",
    {
        "frame": Frame("the tracker's frame, or a frame that it measures: the reference"),
        "pose": Block("the arm's root link in that frame", {"matrix": _MATRIX}),
    },
    optional=True,
)

_HAND = Block(
    "the hand's wrench, and the response to it",
    {
        "topic": Text("WrenchStamped; default: body/measured_cf of the arm", optional=True),
        "axes": Choice("axes of the wrench", ("tool", "base"), default="tool"),
        "linear_mm_s_n": Number("speed per force", default=10.0, minimum=0.0),
        "angular_rad_s_nm": Number("angular speed per torque", default=1.0, minimum=0.0),
        "dead_n": Number("smaller forces count as 0", default=0.1, minimum=0.0),
        "dead_n_m": Number("smaller torques count as 0", default=0.005, minimum=0.0),
        "response_ms": Number("time constant of the response", default=30.0, minimum=0.0),
    },
    optional=True,
)

_IMPEDANCE = Block(
    "for an arm that closes the loop itself (dVRK): the constraint as servo_ci instead of joint "
    "velocities; default: off",
    {
        "stiffness_n_m": Number("beyond the plane, along its normal", above=0.0),
        "damping_n_s_m": Number("the same per speed", minimum=0.0),
        "period_ms": Number("period of the arm's own loop", above=0.0, maximum=20.0),
        "arm_damping_n_s_m": Number("physical damping of the arm at its tip", above=0.0),
    },
    rules=(PASSIVE,),
    optional=True,
)

CONTROL = Block(
    "a cooperative controller between a hand and an arm",
    {
        "schema": Integer("version of the format", 1, 1),
        "name": Text("name of the arm, shown in reports"),
        "arm": Text("namespace of the arm's CRTK topics, such as /arm"),
        "robot": _ROBOT,
        "tool": Block("the tool that the arm holds", _TOOL),
        "tracked_transforms": Text(
            "topic of the tracker (marginguard_msgs/TrackedTransform)",
            optional=True,
        ),
        "base": _BASE,
        "constraint": Text(
            "topic of the guard's constraint; default: /marginguard/constraint", optional=True
        ),
        "hand": _HAND,
        "impedance": _IMPEDANCE,
        "max_speed_mm_s": Number(
            "largest speed of the tip; planes are approached at most at v_max_mm_s of the guard",
            default=100.0,
            above=0.0,
            maximum=250.0,
        ),
        "accept_simulated": Boolean(
            "move by constraints of simulated poses; only where no patient and no robot is",
            default=False,
        ),
    },
    rules=(FILES,),
)


def control_schema_text() -> str:
    """Return the JSON Schema of ``control.yaml``, as indented JSON."""
    schema = json_schema(CONTROL, "control.yaml of MarginGuard, schema 1")
    return json.dumps(schema, indent=2) + "\n"
