"""Plan an approach of a robot: from joint positions to others, or to a pose of a link, touching
nothing. Prints the trajectory as JSON.

A file of positions is a mapping of joints to rad, for sliding joints to m, in YAML or JSON; one of
limits a mapping of joints to acceleration, jerk and, where the robot's file gives none, velocity.
"""

import argparse
import json
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

from app.cli.options import add_package_dirs, folder_path, input_argument, number, output_path

if TYPE_CHECKING:
    from app.geometry import SurfaceMesh, Transform
    from app.planning import MotionLimits
    from app.robot import Robot

NAME = "approach"
SUMMARY = "motion of a robot that touches nothing"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of ``marginguard plan approach``."""
    parser.add_argument(
        "robot", type=input_argument, metavar="ROBOT", help="robot file: URDF, .xacro or AMBF"
    )
    add_package_dirs(parser)
    start = parser.add_mutually_exclusive_group(required=True)
    start.add_argument(
        "--start", type=input_argument, metavar="FILE", help="positions of all joints"
    )
    start.add_argument(
        "--arm", metavar="NAMESPACE",
        help="instead: plan from where this arm stands now, such as /arm, with CRTK's measured_js",
    )  # fmt: skip
    goal = parser.add_mutually_exclusive_group(required=True)
    goal.add_argument(
        "--goal", type=input_argument, metavar="FILE", help="positions of the joints that move"
    )
    goal.add_argument(
        "--goal-pose", nargs=2, metavar=("LINK", "FILE"),
        help="a link and the transform from it to the root link",
    )  # fmt: skip
    parser.add_argument(
        "--structure", nargs="+", action="append", default=[], metavar="FILE",
        help="closed surface in mm (.stl, .ply, .obj) and, unless it is in the frame of the root "
        "link, the transform from its frame to it; may be repeated",
    )  # fmt: skip
    parser.add_argument(
        "--carried", nargs=2, action="append", default=[], metavar=("LINK", "FILE"),
        help="surface in mm of a body that a link carries, in its frame; may be repeated",
    )  # fmt: skip
    limits = parser.add_mutually_exclusive_group(required=True)
    limits.add_argument(
        "--limits", type=input_argument, metavar="FILE", help="limits of the moving joints"
    )
    limits.add_argument(
        "--control", type=Path, metavar="FILE",
        help="instead: the joint_limits of this control.yaml, or of that in this folder",
    )  # fmt: skip
    parser.add_argument(
        "--clearance-mm", type=number, required=True, metavar="MM",
        help="distance that the robot keeps from all structures",
    )  # fmt: skip
    parser.add_argument(
        "--allowed-s", type=number, default=10.0, metavar="S",
        help="give up after this time (default: %(default)g)",
    )  # fmt: skip
    parser.add_argument(
        "--guard", nargs="?", const="/marginguard/constraint", metavar="TOPIC",
        help="take the setup of the guard that runs, for 'plan execute': topic of its constraint "
        "(default: %(const)s)",
    )  # fmt: skip
    parser.add_argument(
        "--report", type=folder_path, metavar="DIR",
        help="write the page approach.html there: the robot along its way, and its distances",
    )  # fmt: skip
    parser.add_argument(
        "-o", "--out", type=output_path, metavar="FILE", help="write the JSON to this file"
    )


def run(options: argparse.Namespace) -> int:
    """Plan the approach and print or write it."""
    from app.files import check_output_path, write_file
    from app.files.extras import check_installed
    from app.report.write import check_writable
    from app.robot import load_robot

    check_installed("ompl", "ruckig")
    if options.out is not None:
        check_output_path(options.out)
    if options.report is not None:
        check_writable(options.report)
    made_from = {} if options.guard is None else {"setup_id": _setup_of(options.guard)}
    from app.planning import nearest_structures, plan_approach, preview_approach, shown_samples

    begin_s = time.monotonic()
    robot = load_robot(options.robot, package_dirs=options.package_dirs)
    structures = _structures(options.structure, robot.root_link)
    carried = _carried(options.carried)
    approach = plan_approach(
        robot,
        _numbers(options.start) if options.arm is None else _measured(options.arm, robot),
        _goal(options, robot),
        structures,
        clearance_mm=options.clearance_mm,
        limits=(
            _limits(options.limits)
            if options.control is None
            else _limits_of_arm(options.control, robot)
        ),
        carried=carried,
        is_over=lambda: time.monotonic() - begin_s > options.allowed_s,
        made_from=made_from,
    )
    if options.report is None:
        nearest = nearest_structures(robot, approach, structures, carried)
    else:
        from app.report.approach_page import approach_page

        shown = preview_approach(robot, approach, structures, carried)
        nearest = shown.nearest
        page = approach_page(shown, robot.name)
        options.report.mkdir(parents=True, exist_ok=True)
        write_file(options.report / "approach.html", page.encode())
    preview = {"samples": shown_samples(len(approach.times_ns)).tolist(), "nearest": nearest}
    text = json.dumps(approach.as_document(robot.name) | {"preview": preview}, allow_nan=False)
    if options.out is None:
        print(text)
    else:
        write_file(options.out, f"{text}\n".encode())
    return 0


def _measured(namespace: str, robot: "Robot") -> dict[str, float]:
    """Positions of the robot's actuated joints, of those that the arm publishes."""
    from app.cli.ros import load_ros
    from app.geometry import InputError

    if not namespace.startswith("/") or namespace.endswith("/"):
        raise InputError(f"--arm is {namespace!r}; expected a namespace such as /arm")
    load_ros("which '--arm' needs")
    from app.bridge.arm_inputs import read_joints

    found, known = read_joints(namespace), robot.actuated_joint_names
    return {name: value for name, value in found.items() if name in known}


def _setup_of(topic: str) -> str:
    """The ``setup_id`` of the guard whose constraint is on ``topic``."""
    from app.cli.ros import load_ros

    load_ros("which '--guard' needs")
    from app.bridge.constraint_message import ConstraintReader

    with ConstraintReader(topic) as reader:
        return reader.read().setup_id


def _goal(options: argparse.Namespace, robot: "Robot") -> "dict[str, float] | Transform":
    from app.files import read_transform

    if options.goal is not None:
        return _numbers(options.goal)
    link, file = options.goal_pose
    return read_transform(input_argument(file), target=robot.root_link, source=link)


def _structures(given: list[list[str]], root: str) -> "dict[str, SurfaceMesh]":
    """Surfaces in the frame ``root``, by the names of their files."""
    from app.files import load_mesh, read_transform
    from app.geometry import InputError

    found: dict[str, SurfaceMesh] = {}
    for file, *pose in given:
        name = Path(file).stem
        if len(pose) > 1 or name in found:
            problem = f"{len(pose)} transforms" if len(pose) > 1 else "a name that is given already"
            raise InputError(f"structure {name!r}: has {problem}; expected other files")
        frame = root if not pose else name
        mesh = load_mesh(input_argument(file), units="mm", frame=frame)
        for each in pose:
            mesh = mesh.transformed(read_transform(input_argument(each), target=root, source=name))
        found[name] = mesh
    return found


def _carried(given: list[list[str]]) -> "dict[str, SurfaceMesh]":
    from app.files import load_mesh

    return {
        Path(file).stem: load_mesh(input_argument(file), units="mm", frame=link)
        for link, file in given
    }


def _limits(path: Path) -> "dict[str, MotionLimits]":
    from app.geometry import InputError
    from app.planning import MotionLimits

    found = {}
    for joint, values in _mapping(path).items():
        allowed = {"acceleration", "jerk"}, {"acceleration", "jerk", "velocity"}
        if not isinstance(values, dict) or set(values) not in allowed:
            raise InputError(
                f"{path}: {joint} is {values}; expected acceleration, jerk and maybe velocity"
            )
        found[joint] = MotionLimits(**_checked(values, f"{path}: {joint}"))
    return found


def _limits_of_arm(path: Path, robot: "Robot") -> "dict[str, MotionLimits]":
    from app.control import open_control
    from app.geometry import InputError
    from app.planning import MotionLimits

    description = open_control(path)
    if description.tool.robot.name != robot.name:
        raise InputError(
            f"--control: is of robot {description.tool.robot.name!r}; expected {robot.name!r}"
        )
    return {name: MotionLimits(*each) for name, each in description.joint_limits.items()}


def _numbers(path: Path) -> dict[str, float]:
    return _checked(_mapping(path), str(path))


def _mapping(path: Path) -> dict[str, Any]:
    from app.files.yaml_file import load_yaml
    from app.geometry import InputError

    values = load_yaml(path)
    if not (isinstance(values, dict) and all(isinstance(key, str) for key in values)):
        raise InputError(f"{path}: is no mapping of joints; expected JOINT: NUMBER on each line")
    return values


def _checked(values: dict[str, Any], place: str) -> dict[str, float]:
    from app.geometry import InputError

    for key, value in values.items():
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise InputError(f"{place}: {key} is {value!r}; expected a number")
    return {key: float(value) for key, value in values.items()}
