"""Description of a file: its kind, by its ending or its content, what it can be used for."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from app.case import recording_formats, recording_kinds
from app.files.bounded_io import is_file, is_folder, open_for_reading
from app.geometry import InputError, MeshError, join_transform_name


@dataclass(frozen=True, slots=True)
class FileInfo:
    """The ``kind`` of a file, ``facts`` by name, its ``uses``, and what is ``missing`` for them.

    ``uses`` are commands or keys of a ``case.yaml``; ``missing`` says what else they need.
    """

    path: str
    kind: str
    facts: Mapping[str, str]
    uses: tuple[str, ...] = ()
    missing: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()

    def as_text(self) -> str:
        """Lines of text."""
        lines = [self.path, f"  {'is':<14} {self.kind}"]
        lines += [f"  {name:<14} {value}" for name, value in self.facts.items()]
        for title, entries in (
            ("can be used", self.uses),
            ("missing", self.missing),
            ("note", self.notes),
        ):
            lines += [f"  {title:<14} {entry}" for entry in entries]
        return "\n".join(lines)


Describe = Callable[[Path, Sequence[Path]], FileInfo]

_YAML = (".yaml", ".yml")
_TRANSFORMS = (".h5", ".hdf5", ".tfm", ".txt")
_ROBOTS = (".urdf", ".xacro", ".adf")
_HEAD_BYTES = 4096
_MIN_CONTOUR = 4
_MIN_SIZE = 1.0


def describe_file(path: Path, package_dirs: Sequence[Path]) -> FileInfo:
    """Describe the file or rosbag2 folder at ``path``.

    Raises `InputError` where it is of no known kind, and the errors of its reader where it cannot
    be read.
    """
    return _describer(path)(path, package_dirs)


def _describer(path: Path) -> Describe:
    from app.cli.recording_info import describe_recording
    from app.files.meshes import MESH_ENDINGS

    name = path.name.lower()
    if not is_file(path) and not is_folder(path):
        raise InputError(f"{path}: no such file or folder; expected one")
    if any(each.recognises(path) for each in recording_formats()):
        return describe_recording
    if is_folder(path):
        raise InputError(f"{path} is a folder without a recording or a case.yaml; expected one")
    by_ending: tuple[tuple[tuple[str, ...], Describe], ...] = (
        (_TRANSFORMS, _describe_transform),
        (MESH_ENDINGS, _describe_mesh),
        (_ROBOTS, _describe_robot),
        ((".mrk.json", ".fcsv"), _describe_points),
        ((".nrrd",), _describe_segmentation),
        ((".xml",), _describe_plus),
        (_YAML, _yaml_describer(path) if name.endswith(_YAML) else _describe_robot),
    )
    for endings, describe in by_ending:
        if name.endswith(endings):
            return describe
    known = ", ".join(ending for endings, _ in by_ending for ending in endings)
    raise InputError(f"{path} is of no known kind; expected {recording_kinds()}, or {known}")


def _yaml_describer(path: Path) -> Describe:
    """A YAML file is a transform, points or a robot (ADF), by its first keys."""
    with open_for_reading(path) as file:
        lines = file.read(_HEAD_BYTES).decode("utf-8", "replace").splitlines()
    keys = {line.partition(":")[0].strip() for line in lines if line[:1] not in ("", " ", "#")}
    if "schema" in keys:
        raise InputError(
            f"{path} is a configuration of a case or a live session; expected the folder of a "
            "case, or a file that it names"
        )
    if "matrix" in keys:
        return _describe_transform
    return _describe_points if "landmarks" in keys else _describe_robot


def _describe_points(path: Path, package_dirs: Sequence[Path]) -> FileInfo:
    """Describe landmarks or a contour."""
    from app.files.landmarks import read_points

    points = read_points(path)
    names = [name for name, _ in points]
    low = [min(point[axis] for _, point in points) for axis in range(3)]
    high = [max(point[axis] for _, point in points) for axis in range(3)]
    size = " x ".join(f"{b - a:.6g}" for a, b in zip(low, high, strict=True))
    uses, missing = [], []
    if len(names) >= _MIN_CONTOUR:
        uses.append(f"tumor.contour of a case.yaml, marginguard tumor {path}")
    else:
        missing.append(f"a contour of a tumour needs {_MIN_CONTOUR} points")
    if all(names) and len(set(names)) == len(names):
        uses.append(f"marginguard calibrate landmarks RECORDING --landmarks {path}")
    else:
        missing.append("landmarks need different names")
    shown = ", ".join(name or "(no name)" for name in names[:12])
    facts = {
        "points": f"{len(points)}, in RAS axes",
        "extent": f"{size} mm",
        "names": shown + (" ..." if len(names) > 12 else ""),
    }
    return FileInfo(str(path), "named points", facts, tuple(uses), tuple(missing))


def _describe_robot(path: Path, package_dirs: Sequence[Path]) -> FileInfo:
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


def _describe_mesh(path: Path, package_dirs: Sequence[Path]) -> FileInfo:
    """Describe a mesh file, and say whether it bounds a solid."""
    from app.files.meshes import load_mesh
    from app.fixture.meshes.mesh_checks import require_sound

    mesh = load_mesh(path, units="mm", frame="mesh")
    lengths = mesh.bounds_mm[1] - mesh.bounds_mm[0]
    size = " x ".join(f"{length:.6g}" for length in lengths)
    # A tool of less than 1 mm in mm is one in metres.
    units = "m" if max(lengths) < _MIN_SIZE else "mm"
    if units == "m":
        mesh = load_mesh(path, units=units, frame="mesh")
    uses: tuple[str, ...] = (f"tool.mesh or tumor.mesh of a case.yaml, with units: {units}",)
    missing = [f"units: the file does not store them; by its size it is in {units}"]
    try:
        require_sound(mesh, f"in {units} it")
        solid = f"yes, {mesh.signed_volume_mm3:.6g} mm3"
    except MeshError as error:
        solid = f"no: {error}"
        uses = (f"marginguard tumor {path} --units {units} --repair: tries to repair it",)
        missing.append("a tool or a tumour needs a mesh that bounds a solid")
    facts = {"triangles": str(len(mesh.faces)), "size": f"{size} units", "bounds a solid": solid}
    return FileInfo(str(path), "a triangle mesh", facts, uses, tuple(missing))


def _describe_segmentation(path: Path, package_dirs: Sequence[Path]) -> FileInfo:
    """Describe a segmentation by the surface of its only segment, or by the names it has."""
    from app.case import tumor_from_segmentation

    missing: tuple[str, ...] = ()
    facts = {}
    try:
        built = tumor_from_segmentation(path, frame="tumor", segment=None)
        facts["surface"] = f"{len(built.mesh.faces)} triangles"
        facts["volume"] = f"{built.mesh.signed_volume_mm3:.6g} mm3"
    except InputError as error:
        if "segment" not in str(error):
            raise
        missing = (str(error),)
    return FileInfo(
        str(path),
        "a segmentation or label map",
        facts,
        ("tumor.mesh of a case.yaml", f"marginguard tumor {path}"),
        missing,
    )


def _describe_transform(path: Path, package_dirs: Sequence[Path]) -> FileInfo:
    """Describe a rigid transform, as Slicer displays its matrix."""
    from app.files.transforms import read_any_transform
    from app.geometry import Transform

    matrix, names = read_any_transform(path)
    pose = Transform.from_matrix(matrix, target="target", source="source")
    angle = math.degrees(pose.angle_to(Transform.identity("target", "source")))
    position = ", ".join(f"{value:.6g}" for value in pose.translation_mm)
    facts = {
        "translation": f"{position} mm",
        "rotation": f"{angle:.6g} degrees",
        "matrix": "; ".join(", ".join(f"{value:.9g}" for value in row) for row in matrix),
    }
    missing = ["its frames: only the YAML format stores them"] if names is None else []
    if names is not None:
        facts["frames"] = f"{names[0]}_from_{names[1]}"
    return FileInfo(
        str(path),
        "a rigid transform, to parent and in RAS as 3D Slicer displays it",
        facts,
        (
            f"marginguard calibrate spin RECORDING --tip-from {path}: the tip of a tool",
            "tool.tip_from, tumor.pose or registration.matrix of a case.yaml: its matrix",
        ),
        tuple(missing),
    )


def _describe_plus(path: Path, package_dirs: Sequence[Path]) -> FileInfo:
    """Describe a configuration of PLUS: transforms and landmarks."""
    from app.files import read_plus_config

    found = read_plus_config(path)
    transforms = [join_transform_name(source, target) for target, source in found.matrices]
    facts = {
        "transforms": ", ".join(transforms) or "none",
        "landmarks": ", ".join(found.landmarks_mm) or "none",
    }
    tips = [name for name in transforms if "TipTo" in name]
    uses = [f"--tip-from {path} of marginguard calibrate: {name}" for name in tips]
    missing = [] if tips else ["no tip of a tool like StylusTipToStylus"]
    if found.landmarks_mm:
        uses.append(f"--plus-config {path} of marginguard calibrate landmarks")
    else:
        missing.append("no landmarks of a phantom")
    return FileInfo(str(path), "a configuration of PLUS", facts, tuple(uses), tuple(missing))
