"""Description of a robot file."""

from collections.abc import Sequence
from pathlib import Path

from app.cli.file_info.file_info import FileInfo


def describe(path: Path, package_dirs: Sequence[Path]) -> FileInfo:
    """Describe a URDF, a xacro file or a description of AMBF, with the meshes that it names."""
    from app.robot import load_robot

    robot = load_robot(path, package_dirs=package_dirs)
    parents = {joint.parent for joint in robot.joints}
    ends = [link.name for link in robot.links if link.name not in parents]
    facts = {
        "name": robot.name,
        "root link": robot.root_link,
        "links": str(len(robot.links)),
        "joints": ", ".join(robot.actuated_joint_names) or "none that move",
        "end links": ", ".join(ends),
    }
    missing = []
    if not robot.actuated_joint_names:
        missing.append("no joint moves: a robot that holds a tool needs some")
    return FileInfo(
        str(path),
        "a robot",
        facts,
        ("robot.urdf of a case.yaml, with robot.tool_link one of the end links",),
        (*missing, "the pose of its base: registration of a case.yaml"),
        tuple(robot.warnings),
    )
