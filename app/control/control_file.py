"""``control.yaml``: the arm, its tool, and where its base is. Its keys, values and reader."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np

from app.control.compliance import AdmittanceGains, ImpedanceParameters
from app.control.controller import ControllerParameters, CooperativeController, ToolKinematics
from app.files.bounded_io import is_file, is_folder
from app.files.declared import block_of, read_as
from app.files.document import Section
from app.files.keys import (
    ROBOT_FILE,
    XACRO_ARGS,
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
from app.files.paths import resolve_file
from app.fixture import FixtureRule, LimiterParameters, PassivityError
from app.geometry import InputError, Transform
from app.robot import load_robot

CONTROL_FILE = "control.yaml"
RULE_FRAME = "tumor"
"""The frame of the guard's constraints."""

BASE = "base"
"""The arm's root link, in the transforms of a `ControlDescription`."""


FILES = "the robot's file exists and has a known format"
JOINTS = "joints are those of the robot, each at most once"
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
        "joint_limits": ListOf(
            "limits of joints in planned motions; default: those of the plan",
            Block(
                "a joint",
                {
                    "joint": Text("its name"),
                    "acceleration": Number("rad/s2 or m/s2", above=0.0),
                    "jerk": Number("rad/s3 or m/s3", above=0.0),
                },
                rules=(JOINTS,),
            ),
            optional=True,
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
        **block_of(AdmittanceGains, "").keys,
    },
    optional=True,
)

_IMPEDANCE = block_of(
    ImpedanceParameters,
    "for an arm that closes the loop itself (dVRK): the constraint as servo_ci instead of joint "
    "velocities; default: off",
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
    replaced={"tumor": "the tumour's pose from the guard's constraint: remove this key"},
)


class JointLimit(NamedTuple):
    """Limits of a joint in planned motions, in rad, for sliding joints in m."""

    acceleration: float
    jerk: float
    velocity: float


@dataclass(frozen=True, slots=True, eq=False)
class ControlDescription:
    """The values of ``control.yaml``.

    ``frame_from_base`` is the registered pose of the arm's root link in the tracker's frame, or
    in one that the tracker measures; it is used where the guard publishes no registration, and
    None if it always has to. The pose of the tumour is that of the guard. ``hand_topic`` has
    the wrench in the tool's axes if ``hand_in_tool``, else in those of the base.
    ``max_speed_mm_s`` limits the tip. ``impedance``: the arm closes the loop itself.
    ``joint_limits`` are by joint, of those that have some.
    """

    name: str
    arm: str
    tool: ToolKinematics
    tracker_topic: str
    constraint_topic: str
    frame_from_base: Transform | None
    hand_topic: str
    hand_in_tool: bool
    parameters: ControllerParameters
    max_speed_mm_s: float
    accept_simulated: bool
    impedance: ImpedanceParameters | None = None
    joint_limits: Mapping[str, JointLimit] = field(default_factory=dict)

    def controller(self) -> CooperativeController:
        """A new controller. Raises `InputError` for a joint without speed limit."""
        rule = FixtureRule(
            frame=RULE_FRAME,
            parameters=LimiterParameters(max_speed_mm_s=self.max_speed_mm_s),
            accept_simulated=self.accept_simulated,
            follows_setup=True,
        )
        return CooperativeController(self.tool, rule, self.parameters)


def open_control(path: Path) -> ControlDescription:
    """Read the control file at ``path``, or ``control.yaml`` in that folder, with its robot.

    Raises `InputError`, or the error of the robot, for the first fault.
    """
    file = path / CONTROL_FILE if is_folder(path) else path
    if not is_file(file):
        raise InputError(f"{path} is not a control file; expected a {CONTROL_FILE} or its folder")
    return read_control(Section.load(file, CONTROL))


def read_control(document: Section) -> ControlDescription:
    """Read a document with the keys of `CONTROL`."""
    document.integer("schema")
    arm = _arm(document)
    block = document.section("robot")
    robot = load_robot(
        resolve_file(block.folder, block.text("file"), block.place("file")),
        xacro_args=block.value("xacro_args"),
        require_meshes=False,
    )
    hand: Section | None = document.value("hand")
    base: Section | None = document.value("base")
    tool = ToolKinematics(robot, _link_from_tip(document.section("tool")))
    max_speed = block.value("max_joint_speed")
    return ControlDescription(
        document.text("name"),
        arm,
        tool,
        _topic(document, "tracked_transforms", "/tracked_transforms"),
        _topic(document, "constraint", "/marginguard/constraint"),
        None
        if base is None
        else base.section("pose").matrix("matrix", target=base.frame("frame"), source=BASE),
        f"{arm}/body/measured_cf"
        if hand is None
        else _topic(hand, "topic", f"{arm}/body/measured_cf"),
        hand is None or hand.choice("axes") == "tool",
        ControllerParameters(
            gains=AdmittanceGains() if hand is None else read_as(AdmittanceGains, hand),
            max_joint_speed=max_speed,
        ),
        document.number("max_speed_mm_s"),
        document.boolean("accept_simulated"),
        _impedance(document),
        _joint_limits(block, tool, max_speed),
    )


def _arm(document: Section) -> str:
    arm = document.text("arm")
    if not arm.startswith("/") or arm.endswith("/"):
        raise InputError(f"{document.place('arm')} is {arm!r}; expected a namespace such as /arm")
    return arm


def _topic(block: Section, key: str, default: str) -> str:
    topic: str = block.value(key) or default
    if not topic.startswith("/"):
        raise InputError(f"{block.place(key)} is {topic!r}; expected a topic that begins with '/'")
    return topic


def _joint_limits(
    robot: Section, tool: ToolKinematics, max_speed: float | None
) -> dict[str, JointLimit]:
    """Raises `InputError` for a joint without speed limit."""
    speeds = dict(zip(tool.joints, tool.limits(max_speed).max_speed.tolist(), strict=True))
    found: dict[str, JointLimit] = {}
    for block in robot.sections("joint_limits") if "joint_limits" in robot else ():
        name = block.text("joint")
        if name in found or name not in speeds:
            raise InputError(
                f"{block.place('joint')} is {name!r}; expected one of {', '.join(speeds)}, once"
            )
        found[name] = JointLimit(block.number("acceleration"), block.number("jerk"), speeds[name])
    return found


def _impedance(document: Section) -> ImpedanceParameters | None:
    try:
        given: ImpedanceParameters | None = document.value("impedance")
    except PassivityError as error:
        raise InputError(f"{document.place('impedance')}.stiffness_n_m: {error}") from error
    return given


def _link_from_tip(block: Section) -> Transform:
    turn = block.value("rotation_deg") or (0.0, 0.0, 0.0)
    return Transform.from_rotation_vector(
        np.radians(turn),
        np.array(block.numbers("position_mm")),
        target=block.frame("link"),
        source="tip",
    )
