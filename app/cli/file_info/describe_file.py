"""Finds what a file is, by its ending and, where endings are shared, by its content."""

from collections.abc import Callable, Sequence
from pathlib import Path

from app.cli.file_info.file_info import FileInfo

Describe = Callable[[Path, Sequence[Path]], FileInfo]

_YAML = (".yaml", ".yml")
_TRANSFORMS = (".h5", ".hdf5", ".tfm", ".txt")
_ROBOTS = (".urdf", ".xacro", ".adf")
_HEAD_BYTES = 4096


def describe_file(path: Path, package_dirs: Sequence[Path]) -> FileInfo:
    """Describe the file or rosbag2 folder at ``path``.

    Raises `InputError` where it is of no known kind, and the errors of its reader where it cannot
    be read.
    """
    return _describer(path)(path, package_dirs)


def _describer(path: Path) -> Describe:
    from app.case import recording_formats, recording_kinds
    from app.cli.file_info import points, recording, robot, surface, transform
    from app.files.bounded_io import is_file, is_folder
    from app.files.meshes import MESH_ENDINGS
    from app.geometry import InputError

    name = path.name.lower()
    if not is_file(path) and not is_folder(path):
        raise InputError(f"{path}: no such file or folder; expected one")
    if any(each.recognises(path) for each in recording_formats()):
        return recording.describe
    if is_folder(path):
        raise InputError(f"{path} is a folder without a recording or a case.yaml; expected one")
    by_ending: tuple[tuple[tuple[str, ...], Describe], ...] = (
        (_TRANSFORMS, transform.describe),
        (MESH_ENDINGS, surface.describe),
        (_ROBOTS, robot.describe),
        ((".mrk.json", ".fcsv"), points.describe),
        ((".nrrd",), surface.describe_segmentation),
        ((".xml",), transform.describe_plus),
        (_YAML, _yaml_describer(path) if name.endswith(_YAML) else robot.describe),
    )
    for endings, describe in by_ending:
        if name.endswith(endings):
            return describe
    known = ", ".join(ending for endings, _ in by_ending for ending in endings)
    raise InputError(f"{path} is of no known kind; expected {recording_kinds()}, or {known}")


def _yaml_describer(path: Path) -> Describe:
    """A YAML file is a transform, points or a robot (ADF), by its first keys."""
    from app.cli.file_info import points, robot, transform
    from app.files.bounded_io import open_for_reading
    from app.geometry import InputError

    with open_for_reading(path) as file:
        lines = file.read(_HEAD_BYTES).decode("utf-8", "replace").splitlines()
    keys = {line.partition(":")[0].strip() for line in lines if line[:1] not in ("", " ", "#")}
    if "schema" in keys:
        raise InputError(
            f"{path} is a configuration of a case or a live session; expected the folder of a "
            "case, or a file that it names"
        )
    if "matrix" in keys:
        return transform.describe
    return points.describe if "landmarks" in keys else robot.describe
