"""Reads ``control.yaml`` and loads the robot that it names."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from app.control.admittance import AdmittanceGains
from app.control.control_keys import CONTROL
from app.control.controller import ControllerParameters, CooperativeController
from app.control.impedance import ImpedanceParameters
from app.control.tool_kinematics import ToolKinematics
from app.files.bounded_io import is_file, is_folder
from app.files.document import Section
from app.files.paths import resolve_file
from app.fixture import FixtureRule, LimiterParameters, PassivityError
from app.geometry import InputError, MarginGuardError, Transform
from app.robot import load_robot

CONTROL_FILE = "control.yaml"
RULE_FRAME = "tumor"
"""The frame of the guard's constraints."""

BASE = "base"
"""The arm's root link, in the transforms of a `ControlDescription`."""


@dataclass(frozen=True, slots=True, eq=False)
class ControlDescription:
    """The values of ``control.yaml``.

    ``frame_from_base`` is the registered pose of the arm's root link in the tracker's frame, or
    in one that the tracker measures; it is used where the guard publishes no registration, and
    None if it always has to. The pose of the tumour is that of the guard. ``hand_topic`` has
    the wrench in the tool's axes if ``hand_in_tool``, else in those of the base.
    ``max_speed_mm_s`` limits the tip. ``impedance``: the arm closes the loop itself.
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
    return read_control(Section.load(file, CONTROL), file.parent)


def read_control(document: Section, folder: Path) -> ControlDescription:
    """Read a document with the keys of `CONTROL`; relative names of files are in ``folder``."""
    document.integer("schema")
    arm = _arm(document)
    block = document.section("robot")
    robot = load_robot(
        resolve_file(folder, block.text("file"), block.place("file")),
        xacro_args=block.texts_by_name("xacro_args") if "xacro_args" in block else None,
        require_meshes=False,
    )
    hand = document.section("hand") if "hand" in document else None
    tool = ToolKinematics(robot, _link_from_tip(document.section("tool")))
    found = ControlDescription(
        document.text("name"),
        arm,
        tool,
        _topic(document, "tracked_transforms", "/tracked_transforms"),
        _topic(document, "constraint", "/marginguard/constraint"),
        _base_pose(document.section("base")) if "base" in document else None,
        f"{arm}/body/measured_cf"
        if hand is None
        else _topic(hand, "topic", f"{arm}/body/measured_cf"),
        hand is None or hand.choice("axes") == "tool",
        ControllerParameters(
            gains=AdmittanceGains() if hand is None else _gains(hand),
            max_joint_speed=block.number("max_joint_speed") if "max_joint_speed" in block else None,
        ),
        document.number("max_speed_mm_s"),
        document.boolean("accept_simulated"),
        _impedance(document.section("impedance")) if "impedance" in document else None,
    )
    found.controller()  # checks the limits of the joints
    return found


def _arm(document: Section) -> str:
    arm = document.text("arm")
    if not arm.startswith("/") or arm.endswith("/"):
        raise InputError(f"{document.place('arm')} is {arm!r}; expected a namespace such as /arm")
    return arm


def _topic(block: Section, key: str, default: str) -> str:
    topic = block.text(key) if key in block else default
    if not topic.startswith("/"):
        raise InputError(f"{block.place(key)} is {topic!r}; expected a topic that begins with '/'")
    return topic


def _gains(hand: Section) -> AdmittanceGains:
    return AdmittanceGains(
        linear_mm_s_n=hand.number("linear_mm_s_n"),
        angular_rad_s_nm=hand.number("angular_rad_s_nm"),
        dead_n=hand.number("dead_n"),
        dead_n_m=hand.number("dead_n_m"),
        response_s=hand.number("response_ms") / 1000.0,
    )


def _impedance(block: Section) -> ImpedanceParameters:
    try:
        return ImpedanceParameters(
            block.number("stiffness_n_m"),
            block.number("damping_n_s_m"),
            block.number("period_ms") / 1000.0,
            block.number("arm_damping_n_s_m"),
        )
    except PassivityError as error:
        raise InputError(f"{block.place('stiffness_n_m')}: {error}") from error


def _link_from_tip(block: Section) -> Transform:
    turn = block.numbers("rotation_deg") if "rotation_deg" in block else (0.0, 0.0, 0.0)
    return Transform.from_rotation_vector(
        np.radians(turn),
        np.array(block.numbers("position_mm")),
        target=block.frame("link"),
        source="tip",
    )


def _base_pose(block: Section) -> Transform:
    frame, pose = block.frame("frame"), block.section("pose")
    try:
        return Transform.from_matrix(pose.numbers("matrix"), target=frame, source=BASE)
    except MarginGuardError as error:
        raise InputError(f"{pose.place('matrix')}: {error}") from error
