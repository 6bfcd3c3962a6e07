"""Loads the robot that a case names, with its xacro arguments and packages."""

from app.case import Case
from app.robot import Robot, load_robot


def load_case_robot(case: Case) -> Robot:
    """Load the robot of ``case``. Raises `InputError` for a case without one, else as `load_robot`.

    Its warnings become notes of the case. Takes up to seconds, for its meshes.
    """
    entry = case.manifest.robot
    robot = load_robot(
        case.robot_urdf(),
        package_dirs=case.package_dirs,
        xacro_args={} if entry is None else entry.xacro_args,
        require_meshes=entry is None or entry.require_meshes,
    )
    case.add_notes([f"the robot: {warning}" for warning in robot.warnings])
    return robot
