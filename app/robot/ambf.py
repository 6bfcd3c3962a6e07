"""Loads the description file (ADF) or the map of mesh files of the simulator AMBF as a `Robot`.

``world``, the simulator's frame, is the root of all links. A body without a parent is at its
``location``, the pose of the frame of its mesh, which the simulator publishes (Munawar et al.,
AMBF, IROS 2019). The inertial offset applies to the mass and to collision primitives without an
offset of their own. A joint rotates or slides about ``child axis`` through ``child pivot``, both in
the child's frame; `ambf_joints` has its pose at position 0. Further joints of a body close loops.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from app.geometry import FloatArray, FrameError, MeshError, SurfaceMesh, Transform, TransformError
from app.robot.adf import AdfDocument, AdfSection, read_adf
from app.robot.ambf_joints import (
    AdfJoint,
    read_joint,
    spanning_tree,
    split_ball,
)
from app.robot.ambf_shapes import BodyShapes
from app.robot.closed_tree import CLOSED
from app.robot.elements import (
    MM_PER_M,
    AdfError,
    Joint,
    JointType,
    Link,
    LinkInertia,
    RobotMeshError,
    Shape,
    UrdfError,
)
from app.robot.mesh_locator import MeshLocator, read_robot_mesh
from app.robot.robot import Robot

WORLD, WORLD_BODY = "world", "world-body"
MAX_MAP_CHARACTERS = 1_000_000


def load_adf(
    path: str | Path,
    *,
    package_dirs: Sequence[str | Path] = (),
    require_meshes: bool = True,
) -> Robot:
    """Load an ADF file; the first link is ``world``.

    A mesh that is missing at its path is looked for in ``package_dirs`` and beside the file (see
    `ambf_shapes`). `Robot.warnings` lists meshes found elsewhere, joints that do not fit the
    locations of the bodies, and loops that rounded numbers leave open. Joints that close loops are
    in `Robot.closures`. Raises `AdfError` for a malformed file, for joints of several degrees of
    freedom other than point-to-point and for loops that do not close, and `RobotMeshError` for a
    mesh for collision that is missing or malformed, unless ``require_meshes`` is false.
    """
    path = Path(path)
    document = read_adf(path)
    names = _body_names(document, path)
    shapes = BodyShapes(path, document.settings, package_dirs, require_meshes)
    try:
        # Numbers that overflow become infinite and are refused by the values that hold them.
        with np.errstate(all="ignore"):
            mechanism = _Mechanism(document, names)
            bodies = {
                name: replace(
                    shapes.link(name, document.bodies[key]),
                    inertia=_inertia(name, document.bodies[key]),
                )
                for key, name in names.items()
            }
            links = (bodies.pop(WORLD, Link(WORLD)), *bodies.values(), *mechanism.more_links)
            warnings = dict.fromkeys((*shapes.warnings, *mechanism.warnings))
            robot = Robot(
                path.stem,
                links,
                tuple(mechanism.joints),
                tuple(warnings),
                tuple(shapes.without_collision),
                mechanism.closures,
            )
            return mechanism.warn_of_gaps(robot)
    except (UrdfError, TransformError, FrameError) as problem:
        raise AdfError(f"{path}: {problem}") from problem
    except np.linalg.LinAlgError as problem:
        raise AdfError(f"{path}: a location or a loop has no solution: {problem}") from problem
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


class _Mechanism:
    """Links, joints and loop closures of the file; a body without parent is fixed to ``world``."""

    def __init__(self, document: AdfDocument, names: Mapping[str, str]) -> None:
        self.warnings: list[str] = []
        self._document = document
        self._names = names
        self._world_from = {
            name: document.bodies[key].pose("location") for key, name in names.items()
        }
        read = [self._read(key, section) for key, section in document.joints.items()]
        self.warnings.extend(joint.note for joint in read if joint.note is not None)
        children = {joint.child for joint in read}
        roots = [name for name in self._world_from if name not in children]
        fixed = (name for name in roots if name != WORLD)
        tree, closing = spanning_tree(read, roots)
        self.joints = [_fixed_in_world(name, self._world_from[name]) for name in fixed]
        self.closures = tuple(joint.closure() for joint in closing)
        self.more_links: list[Link] = []
        for joint in tree:
            if joint.is_ball:
                self._add_ball(joint)
            else:
                self.joints.append(joint.joint())

    def warn_of_gaps(self, robot: Robot) -> Robot:
        """``robot`` with a warning for each loop that rounded numbers leave open."""
        warnings = [
            f"joint {closure.name!r} between {closure.parent!r} and {closure.child!r} closes its "
            f"loop up to {gap_mm:.3g} mm and {math.degrees(gap_rad):.3g} degrees, the rounding of "
            "the file"
            for closure, (gap_mm, gap_rad) in zip(robot.closures, robot.loop_gaps, strict=True)
            if max(gap_mm, gap_rad) > CLOSED
        ]
        return replace(robot, warnings=(*robot.warnings, *warnings)) if warnings else robot

    def _add_ball(self, joint: AdfJoint) -> None:
        links, joints = split_ball(joint)
        self.more_links.extend(map(Link, links))
        self.joints.extend(joints)
        self.warnings.append(
            f"{joint.place}: the point-to-point joint, the only one of body {joint.child!r}, is "
            f"modelled as the joints {', '.join(each.name for each in joints)}"
        )

    def _read(self, key: str, section: AdfSection) -> AdfJoint:
        parent, child = self._body(section, "parent"), self._body(section, "child")
        if child == WORLD:
            raise AdfError(f"{section.place}: child is {WORLD!r}, the root; expected another body")
        if parent == child:
            raise AdfError(f"{section.place}: parent and child are {child!r}; expected two bodies")
        name = _ros_name(section, key)
        world_from = {WORLD: np.eye(4), **self._world_from}
        return read_joint(section, name, (parent, world_from[parent]), (child, world_from[child]))

    def _body(self, section: AdfSection, role: str) -> str:
        """Return the link of a joint, given by the key of its section or by the body's name."""
        body = section.text(role)
        if body in self._names:
            return self._names[body]
        if body.replace(" ", "") in (WORLD, *self._names.values()):
            return body.replace(" ", "")
        raise AdfError(
            f"{section.place}: {role} is {body!r}; expected one of {', '.join(self._names)}"
        )


def _body_names(document: AdfDocument, path: Path) -> dict[str, str]:
    """Names of the links by the key of their body.

    A body ``world`` at the origin and without a parent is the root; elsewhere it is a link
    ``world-body``. Raises `AdfError` for two bodies of one name.
    """
    names = {key: _ros_name(section, key) for key, section in document.bodies.items()}
    keys: dict[str, str] = {}
    for key, name in names.items():
        if name in keys:
            raise AdfError(
                f"{path}: the bodies {keys[name]!r} and {key!r} are both named {name!r}; "
                "expected different names"
            )
        keys[name] = key
    if WORLD in keys:
        is_child = any(
            section.values.get("child") in (keys[WORLD], WORLD)
            for section in document.joints.values()
        )
        location = document.bodies[keys[WORLD]].pose("location")
        if is_child or not np.array_equal(location, np.eye(4)):
            if WORLD_BODY in keys:
                raise AdfError(f"{path} has the bodies {WORLD!r} and {WORLD_BODY!r}; expected one")
            names[keys[WORLD]] = WORLD_BODY
    return names


def _inertia(name: str, body: AdfSection) -> LinkInertia | None:
    """The mass of a body; None for a mass of 0, which holds the body in place in the simulator."""
    mass = body.number("mass", 0.0)
    if mass == 0.0:
        return None
    matrix = body.pose("inertial offset")
    matrix[:3, 3] *= MM_PER_M
    tensor = None
    if "inertia" in body:
        tensor = np.diag(body.inside("inertia").numbers(("ix", "iy", "iz")))
    return LinkInertia(mass, Transform.from_matrix(matrix, target=name, source=name), tensor)


def _fixed_in_world(name: str, world_from_body: FloatArray) -> Joint:
    matrix = world_from_body.copy()
    matrix[:3, 3] *= MM_PER_M
    origin = Transform.from_matrix(matrix, target=WORLD, source=name)
    return Joint(f"{WORLD}-{name}", JointType.FIXED, origin, np.array([0.0, 0.0, 1.0]))


def _ros_name(section: AdfSection, key: str) -> str:
    """Return the name in the simulator, without spaces."""
    return section.text("name", key).replace(" ", "")
