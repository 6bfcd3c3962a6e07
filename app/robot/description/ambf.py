"""AMBF: a simulator's description file, or its map of mesh files, as a `Robot`.

All links hang on ``world``, the simulator's own frame. With the joints at 0 every body is where
its ``location`` says, which is the pose of the frame that its mesh is in and that the simulator
publishes (Munawar et al., AMBF, IROS 2019): the inertial offset places the mass, and a collision
primitive that has no offset of its own, and nothing else. A joint turns or slides about its child's
``child axis`` through ``child pivot``.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np

from app.geometry import FloatArray, FrameError, MeshError, SurfaceMesh, Transform, TransformError
from app.robot.description.adf import AdfDocument, Section, read_adf
from app.robot.description.ambf_shapes import BodyShapes
from app.robot.description.mesh_locator import MeshLocator
from app.robot.errors import AdfError, RobotMeshError, UrdfError
from app.robot.kinematics.joint import MM_PER_M, Joint, JointType
from app.robot.meshes.mesh_file import read_robot_mesh
from app.robot.robot import Robot
from app.robot.shapes import Link, Shape

WORLD = "world"
MAX_MAP_CHARACTERS = 1_000_000

_TURNING = ("hinge", "revolute", "continuous", "torsion spring", "torsional spring")
_SLIDING = ("slider", "prismatic", "linear spring", "spring")
_PIVOT_TOLERANCE_MM = 2.0
_AXIS_TOLERANCE_RAD = math.radians(1.0)


def load_adf(path: str | Path, *, package_dirs: Sequence[str | Path] = ()) -> Robot:
    """Load an ADF file; its first link is ``world``.

    A mesh that is not where the file says is looked for in ``package_dirs`` and beside the file
    (see `ambf_shapes`), and `Robot.warnings` says which one was taken; so it does where
    pivots and axes do not fit the bodies' locations, which are what counts. Raises `AdfError` for
    what is malformed, for joints of more than one degree of freedom and for closed loops,
    `RobotMeshError` for a mesh for collision that is missing or broken.
    """
    path = Path(path)
    document = read_adf(path)
    names = {key: _ros_name(section, key) for key, section in document.bodies.items()}
    if len({WORLD, *names.values()}) != len(names) + 1:
        raise AdfError(f"{path} has two bodies of one name, or one that is called {WORLD!r}")
    shapes = BodyShapes(path, document.settings, package_dirs)
    joints = _Joints(document, names)
    try:
        links = tuple(shapes.link(names[key], body) for key, body in document.bodies.items())
        all_joints = tuple(joints.read())
        warnings = dict.fromkeys((*shapes.warnings, *joints.warnings))
        return Robot(path.stem, (Link(WORLD), *links), all_joints, tuple(warnings))
    except (UrdfError, TransformError, FrameError) as problem:
        raise AdfError(f"{path}: {problem}") from problem


def parse_mesh_map(text: str) -> dict[str, str]:
    """``name:path;name:path`` (the parameter ``/ambf/rigid_body_mesh_path_map``) to paths by name.

    Spaces around both and a last ``;`` do not count. Raises `AdfError` for anything else.
    """
    if len(text) > MAX_MAP_CHARACTERS:
        raise AdfError(
            f"the map of meshes has {len(text)} characters: {MAX_MAP_CHARACTERS} are allowed"
        )
    paths: dict[str, str] = {}
    for entry in filter(str.strip, text.split(";")):
        name, colon, path = (part.strip() for part in entry.partition(":"))
        if not (name and colon and path):
            raise AdfError(f"the map of meshes has the entry {entry[:80]!r}: name:path wanted")
        if name in paths:
            raise AdfError(f"the map of meshes names the body {name!r} twice")
        paths[name] = path
    if not paths:
        raise AdfError("the map of meshes is empty: name:path;name:path wanted")
    return paths


def bodies_from_mesh_map(
    text: str,
    *,
    package_dirs: Sequence[str | Path] = (),
    allowed_dirs: Sequence[str | Path] = (),
) -> Robot:
    """The free bodies of a map of meshes, each with its mesh (m): a `Robot` for tf to place.

    The map may come from the network: nothing outside the allowed folders is read, as in
    `robot_from_text`. A mesh that is missing or broken raises `RobotMeshError`.
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
        shape = Shape.of(surface, file.face_colors, mesh)
        links.append(Link(name, (shape,), (shape,)))
    return Robot("ambf", tuple(links), tuple(joints))


class _Joints:
    """The file's joints, and one that fixes each body without a parent in the world."""

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

    def _joint(self, key: str, section: Section) -> Joint:
        parent, child = self._body(section, "parent"), self._body(section, "child")
        kind = section.text("type")
        matrix = np.linalg.solve(self._world_from[parent], self._world_from[child])
        matrix[:3, 3] *= MM_PER_M
        origin = Transform.from_matrix(matrix, target=parent, source=child)
        name = _ros_name(section, key)
        if kind == "fixed":
            return Joint(name, JointType.FIXED, origin, np.array([0.0, 0.0, 1.0]))
        if kind not in (*_TURNING, *_SLIDING):
            raise AdfError(
                f"{section.place} has the type {kind!r}: one of "
                f"{', '.join((*_TURNING, *_SLIDING))} or fixed wanted"
            )
        lower, upper = -math.inf, math.inf
        limits = section.inside("joint limits")
        if "low" in limits and "high" in limits:
            lower, upper = limits.number("low"), limits.number("high")
        axis = section.inside("child axis").numbers("xyz")
        pivot_mm = MM_PER_M * section.inside("child pivot").numbers("xyz")
        self._compare(section, origin, axis, pivot_mm, slides=kind in _SLIDING)
        if section.number("joint offset", 0.0) != 0.0:
            self.warnings.append(
                f"{section.place}: 'joint offset' is not applied, positions count from the "
                "bodies' locations"
            )
        turning = JointType.CONTINUOUS if math.isinf(lower) else JointType.REVOLUTE
        joint_type = JointType.PRISMATIC if kind in _SLIDING else turning
        return Joint(name, joint_type, origin, axis, lower, upper, pivot_mm=pivot_mm)

    def _body(self, section: Section, role: str) -> str:
        """The link that a joint means: by the section's key, or by the body's name."""
        wanted = section.text(role)
        if wanted in self._names:
            return self._names[wanted]
        if wanted.replace(" ", "") in self._names.values():
            return wanted.replace(" ", "")
        raise AdfError(
            f"{section.place}: {role} {wanted!r} is no body: {', '.join(self._names)} are"
        )

    def _compare(
        self, section: Section, origin: Transform, axis: FloatArray, pivot_mm: FloatArray,
        *, slides: bool,
    ) -> None:  # fmt: skip
        """Warn where the axis of the parent is not the child's, with the bodies as located."""
        if not ("parent axis" in section and "parent pivot" in section):
            return
        here = origin.rotate(axis)
        there = section.inside("parent axis").numbers("xyz")
        lengths = np.linalg.norm(here) * np.linalg.norm(there)
        if lengths == 0.0:  # Joint refuses the child's; the parent's says nothing then
            return
        angle = math.acos(float(np.clip(here @ there / lengths, -1.0, 1.0)))
        gap_mm = origin.apply(pivot_mm) - MM_PER_M * section.inside("parent pivot").numbers("xyz")
        if slides:  # it may be anywhere along its way
            gap_mm = gap_mm - (gap_mm @ here) * here / (here @ here)
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


def _ros_name(section: Section, key: str) -> str:
    """What the simulator calls it: without spaces."""
    return section.text("name", key).replace(" ", "")
