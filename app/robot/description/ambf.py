"""Loads the description file (ADF) or the map of mesh files of the simulator AMBF as a `Robot`.

``world``, the simulator's frame, is the root of all links. With the joints at 0 every body is at
its ``location``, the pose of the frame of its mesh, which the simulator publishes (Munawar et al.,
AMBF, IROS 2019). The inertial offset applies to the mass and to collision primitives without an
offset of their own. A joint rotates or slides about ``child axis`` through ``child pivot``, both in
the child's frame.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np

from app.geometry import FloatArray, FrameError, MeshError, SurfaceMesh, Transform, TransformError
from app.robot.description.adf import AdfDocument, AdfSection, read_adf
from app.robot.description.ambf_shapes import BodyShapes
from app.robot.description.mesh_locator import MeshLocator
from app.robot.errors import AdfError, RobotMeshError, UrdfError
from app.robot.kinematics.joint import MM_PER_M, Joint, JointType
from app.robot.meshes.mesh_file import read_robot_mesh
from app.robot.robot import Robot
from app.robot.shapes import Link, Shape

WORLD = "world"
MAX_MAP_CHARACTERS = 1_000_000

_REVOLUTE_TYPES = ("hinge", "revolute", "continuous", "torsion spring", "torsional spring")
_PRISMATIC_TYPES = ("slider", "prismatic", "linear spring", "spring")
_PIVOT_TOLERANCE_MM = 2.0
_AXIS_TOLERANCE_RAD = math.radians(1.0)


def load_adf(path: str | Path, *, package_dirs: Sequence[str | Path] = ()) -> Robot:
    """Load an ADF file; the first link is ``world``.

    A mesh that is missing at its path is looked for in ``package_dirs`` and beside the file (see
    `ambf_shapes`). `Robot.warnings` lists meshes found elsewhere, and pivots and axes that do not
    fit the locations of the bodies; the locations are used. Raises `AdfError` for a malformed
    file, for joints of several degrees of freedom and for closed loops, and `RobotMeshError` for a
    mesh for collision that is missing or malformed.
    """
    path = Path(path)
    document = read_adf(path)
    names = {key: _ros_name(section, key) for key, section in document.bodies.items()}
    if len({WORLD, *names.values()}) != len(names) + 1:
        raise AdfError(f"{path} has two bodies of one name, or one named {WORLD!r}")
    shapes = BodyShapes(path, document.settings, package_dirs)
    try:
        # Numbers that overflow become infinite and are refused by the values that hold them.
        with np.errstate(all="ignore"):
            joints = _Joints(document, names)
            links = tuple(shapes.link(names[key], body) for key, body in document.bodies.items())
            all_joints = tuple(joints.read())
            warnings = dict.fromkeys((*shapes.warnings, *joints.warnings))
            return Robot(path.stem, (Link(WORLD), *links), all_joints, tuple(warnings))
    except (UrdfError, TransformError, FrameError) as problem:
        raise AdfError(f"{path}: {problem}") from problem
    except (RobotMeshError, MeshError) as problem:
        raise RobotMeshError(f"{path}: {problem}") from problem


def parse_mesh_map(text: str) -> dict[str, str]:
    """Parse ``name:path;name:path`` (the parameter ``/ambf/rigid_body_mesh_path_map``).

    Returns paths by name. White space and a final ``;`` are ignored. Raises `AdfError` for a
    malformed map.
    """
    if len(text) > MAX_MAP_CHARACTERS:
        raise AdfError(
            f"the map of meshes has {len(text)} characters; expected at most {MAX_MAP_CHARACTERS}"
        )
    paths: dict[str, str] = {}
    for entry in filter(str.strip, text.split(";")):
        name, colon, path = (part.strip() for part in entry.partition(":"))
        if not (name and colon and path):
            raise AdfError(f"the map of meshes has the entry {entry[:80]!r}; expected name:path")
        if name in paths:
            raise AdfError(f"the map of meshes names the body {name!r} twice")
        paths[name] = path
    if not paths:
        raise AdfError("the map of meshes is empty; expected name:path;name:path")
    return paths


def bodies_from_mesh_map(
    text: str,
    *,
    package_dirs: Sequence[str | Path] = (),
    allowed_dirs: Sequence[str | Path] = (),
) -> Robot:
    """Load the free bodies of a map of meshes (m) as a `Robot` with poses from tf.

    The map may come from the network: nothing outside the allowed folders is read, as in
    `robot_from_text`. A missing or malformed mesh raises `RobotMeshError`.
    """
    locator = MeshLocator(None, package_dirs, allowed_dirs=allowed_dirs)
    links, joints = [Link(WORLD)], []
    for name, mesh in parse_mesh_map(text).items():
        path = locator.find(mesh)
        if path is None:
            raise RobotMeshError(f"mesh {mesh!r} of body {name!r} not found")
        try:
            file = read_robot_mesh(path)
            surface = SurfaceMesh(name, file.vertices * MM_PER_M, file.faces.astype(np.int32))
            joints.append(_fixed_in_world(name, np.eye(4)))
        except (FrameError, MeshError) as problem:
            raise AdfError(f"body {name!r} of the map of meshes: {problem}") from problem
        shape = Shape.with_face_colors(surface, file.face_colors, mesh)
        links.append(Link(name, (shape,), (shape,)))
    return Robot("ambf", tuple(links), tuple(joints))


class _Joints:
    """The joints of the file, and a fixed joint to ``world`` for each body without a parent."""

    def __init__(self, document: AdfDocument, names: Mapping[str, str]) -> None:
        self.warnings: list[str] = []
        self._document = document
        self._names = names
        self._world_from = {
            name: document.bodies[key].pose("location") for key, name in names.items()
        }

    def read(self) -> Iterable[Joint]:
        joints = [self._joint(key, section) for key, section in self._document.joints.items()]
        children = {joint.child for joint in joints}
        for name, matrix in self._world_from.items():
            if name not in children:
                yield _fixed_in_world(name, matrix)
        yield from joints

    def _joint(self, key: str, section: AdfSection) -> Joint:
        parent, child = self._body(section, "parent"), self._body(section, "child")
        kind = section.text("type")
        matrix = np.linalg.solve(self._world_from[parent], self._world_from[child])
        matrix[:3, 3] *= MM_PER_M
        origin = Transform.from_matrix(matrix, target=parent, source=child)
        name = _ros_name(section, key)
        if kind == "fixed":
            return Joint(name, JointType.FIXED, origin, np.array([0.0, 0.0, 1.0]))
        if kind not in (*_REVOLUTE_TYPES, *_PRISMATIC_TYPES):
            raise AdfError(
                f"{section.place} has the type {kind!r}; expected one of "
                f"{', '.join((*_REVOLUTE_TYPES, *_PRISMATIC_TYPES))} or fixed"
            )
        lower, upper = -math.inf, math.inf
        limits = section.inside("joint limits")
        if "low" in limits and "high" in limits:
            lower, upper = limits.number("low"), limits.number("high")
        axis = section.inside("child axis").numbers("xyz")
        pivot_mm = MM_PER_M * section.inside("child pivot").numbers("xyz")
        self._warn_on_mismatch(section, origin, axis, pivot_mm, slides=kind in _PRISMATIC_TYPES)
        if section.number("joint offset", 0.0) != 0.0:
            self.warnings.append(
                f"{section.place}: 'joint offset' is not applied, position 0 is at the "
                "bodies' locations"
            )
        revolute = JointType.CONTINUOUS if math.isinf(lower) else JointType.REVOLUTE
        joint_type = JointType.PRISMATIC if kind in _PRISMATIC_TYPES else revolute
        return Joint(name, joint_type, origin, axis, lower, upper, pivot_mm=pivot_mm)

    def _body(self, section: AdfSection, role: str) -> str:
        """Return the link of a joint, given by the key of its section or by the body's name."""
        body = section.text(role)
        if body in self._names:
            return self._names[body]
        if body.replace(" ", "") in self._names.values():
            return body.replace(" ", "")
        raise AdfError(
            f"{section.place}: {role} is {body!r}; expected one of {', '.join(self._names)}"
        )

    def _warn_on_mismatch(
        self, section: AdfSection, origin: Transform, axis: FloatArray, pivot_mm: FloatArray,
        *, slides: bool,
    ) -> None:  # fmt: skip
        """Warn if parent axis and pivot differ from the child's, with bodies at their locations."""
        if not ("parent axis" in section and "parent pivot" in section):
            return
        child_axis = origin.rotate(axis)
        parent_axis = section.inside("parent axis").numbers("xyz")
        lengths = np.linalg.norm(child_axis) * np.linalg.norm(parent_axis)
        if lengths == 0.0:  # Joint refuses a zero child axis; a zero parent axis is ignored
            return
        angle = math.acos(float(np.clip(child_axis @ parent_axis / lengths, -1.0, 1.0)))
        gap_mm = origin.apply(pivot_mm) - MM_PER_M * section.inside("parent pivot").numbers("xyz")
        if slides:  # a distance along the axis is a joint position
            along = (gap_mm @ child_axis) * child_axis / (child_axis @ child_axis)
            gap_mm = gap_mm - along
        distance_mm = float(np.linalg.norm(gap_mm))
        if angle > _AXIS_TOLERANCE_RAD or distance_mm > _PIVOT_TOLERANCE_MM:
            self.warnings.append(
                f"{section.place}: with the bodies at their locations the pivots are "
                f"{distance_mm:.3g} mm and the axes {math.degrees(angle):.3g} degrees apart"
            )


def _fixed_in_world(name: str, world_from_body: FloatArray) -> Joint:
    matrix = world_from_body.copy()
    matrix[:3, 3] *= MM_PER_M
    origin = Transform.from_matrix(matrix, target=WORLD, source=name)
    return Joint(f"{WORLD}-{name}", JointType.FIXED, origin, np.array([0.0, 0.0, 1.0]))


def _ros_name(section: AdfSection, key: str) -> str:
    """Return the name in the simulator, without spaces."""
    return section.text("name", key).replace(" ", "")
