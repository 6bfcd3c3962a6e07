"""Loads a robot description as a `Robot`: links with surfaces in mm, joints with origins."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from app.files.mesh_file import FileMesh
from app.files.xml_guard import read_xml
from app.geometry import FloatArray, FrameError, MeshError, SurfaceMesh, Transform, TransformError
from app.robot import primitives
from app.robot.elements import (
    MM_PER_M,
    Joint,
    JointDynamics,
    JointType,
    Link,
    LinkInertia,
    Mimic,
    Rgba,
    RobotMeshError,
    Shape,
    UrdfError,
)
from app.robot.mesh_locator import MeshLocator, read_robot_mesh
from app.robot.robot import Robot
from app.robot.urdf import MAX_URDF_BYTES, parse_urdf, read_urdf

ADF_SUFFIXES = (".yaml", ".yml", ".adf")
MAX_TEXT_BYTES = 8 * 1024 * 1024
"""Limit for a description from the network; those of real robots have a few hundred kB."""


def load_robot(
    path: str | Path,
    *,
    package_dirs: Sequence[str | Path] = (),
    xacro_args: Mapping[str, str] | None = None,
    require_meshes: bool = True,
) -> Robot:
    """Load a robot file: URDF, ``.xacro`` (see `expand_xacro`) or AMBF's ADF (``.yaml``).

    Every visual and every collision of every link is read. ``package_dirs`` are folders of
    ``package://`` names (see `mesh_locator`, which also searches others). A missing or malformed
    mesh raises `RobotMeshError` if it is for collision. Without ``require_meshes`` the link has no
    collision shapes, is named in `Robot.links_without_collision`, and the robot is for its
    kinematics. A mesh for display is left out with a sentence in `Robot.warnings`. A name that
    leaves its package or needs a network is refused in both. Raises `UrdfError` or `AdfError` for
    a description that is unsafe, malformed or not one tree of links, and for ``xacro_args`` with
    another file than xacro.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if xacro_args and suffix != ".xacro":
        raise UrdfError(
            f"{path} has xacro arguments ({', '.join(xacro_args)}); expected a .xacro file"
        )
    if suffix in ADF_SUFFIXES:
        from app.robot.ambf import load_adf

        return load_adf(path, package_dirs=package_dirs, require_meshes=require_meshes)
    locator = MeshLocator(path, package_dirs)
    if suffix == ".xacro":
        from app.robot.urdf import expand_xacro

        data = expand_xacro(path, xacro_args or {}, package_dirs)
        return _robot(parse_urdf(data, f"{path}, expanded by xacro"), locator, path, require_meshes)
    return _robot(read_urdf(path), locator, path, require_meshes)


def urdf_text(
    path: str | Path,
    *,
    package_dirs: Sequence[str | Path] = (),
    xacro_args: Mapping[str, str] | None = None,
) -> str | None:
    """Return the URDF text of a robot file, expanded if it is xacro; None for an ADF."""
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix in ADF_SUFFIXES:
        return None
    if suffix == ".xacro":
        from app.robot.urdf import expand_xacro

        return expand_xacro(path, xacro_args or {}, package_dirs).decode()
    return read_xml(path, UrdfError, max_bytes=MAX_URDF_BYTES).decode()


def robot_from_text(
    text: str,
    *,
    name: str = "robot_description",
    package_dirs: Sequence[str | Path] = (),
    allowed_dirs: Sequence[str | Path] = (),
) -> Robot:
    """Load a robot from the text of an untrusted URDF; ``name`` is for messages.

    Differs from `load_robot`: nothing is read outside ``package_dirs``, ``allowed_dirs``, installed
    ROS packages and the project's data (`RobotMeshError`), the text has at most `MAX_TEXT_BYTES`,
    and it is never expanded by xacro.
    """
    if len(text) > MAX_TEXT_BYTES:  # before the text is copied to bytes
        raise UrdfError(
            f"{name} has {len(text)} characters; expected at most {MAX_TEXT_BYTES} bytes"
        )
    try:
        data = text.encode()
    except UnicodeEncodeError as problem:
        raise UrdfError(f"{name} cannot be encoded as UTF-8: {problem.reason}") from problem
    model = parse_urdf(data, name, max_bytes=MAX_TEXT_BYTES)
    return _robot(model, MeshLocator(None, package_dirs, allowed_dirs=allowed_dirs), name)


def _robot(
    model: Any, locator: MeshLocator, name: Path | str, require_meshes: bool = True
) -> Robot:
    try:
        # Numbers that overflow become infinite and are refused by the values that hold them.
        with np.errstate(all="ignore"):
            return _assembled(model, locator, require_meshes)
    except (UrdfError, TransformError, FrameError) as problem:
        raise UrdfError(f"{name}: {problem}") from problem
    except (RobotMeshError, MeshError) as problem:
        raise RobotMeshError(f"{name}: {problem}") from problem


def _assembled(model: Any, locator: MeshLocator, require_meshes: bool) -> Robot:
    shapes = _ShapeReader(locator, _named_colors(model), require_meshes)
    names = {joint.name for joint in model.joints}
    for joint in model.joints:
        if joint.mimic is not None and joint.mimic.joint not in names:
            shapes.warnings.append(
                f"joint {joint.name!r} mimics {joint.mimic.joint!r}, which is not a joint: it is "
                "treated as an actuated joint"
            )
            joint.mimic = None
    joints = tuple(_joint(each) for each in model.joints)
    links = tuple(
        Link(
            link.name,
            tuple(shape for each in link.visuals if (shape := shapes.visual(link.name, each))),
            shapes.collisions(link.name, link.collisions),
            _inertia(link),
        )
        for link in model.links
    )
    return Robot(model.name, links, joints, tuple(shapes.warnings), tuple(shapes.without_collision))


class _ShapeReader:
    """Converts visuals and collisions to shapes; each mesh file is read once."""

    def __init__(
        self, locator: MeshLocator, named_colors: Mapping[str, Rgba], require_meshes: bool
    ) -> None:
        self.warnings: list[str] = []
        self.without_collision: list[str] = []
        self._require_meshes = require_meshes
        self._locator = locator
        self._named_colors = named_colors
        self._files: dict[Path, FileMesh] = {}

    def visual(self, link: str, visual: Any) -> Shape | None:
        mesh = visual.geometry.mesh
        if mesh is not None and self._locator.find(mesh.filename) is None:
            self.warnings.append(f"display {_missing(mesh.filename, link)}")
            return None
        try:
            shape = self._shape(link, visual)
        except (RobotMeshError, MeshError) as problem:
            self.warnings.append(f"display of link {link!r} left out: {problem}")
            return None
        material, color = visual.material, None
        if material is not None:
            color = _rgba(material) or self._named_colors.get(material.name)
        return shape if color is None else Shape(shape.mesh, color, shape.source)

    def collisions(self, link: str, collisions: Sequence[Any]) -> tuple[Shape, ...]:
        try:
            return tuple(self._collision(link, each) for each in collisions)
        except (RobotMeshError, MeshError) as problem:
            if self._require_meshes:
                raise
            self.without_collision.append(link)
            self.warnings.append(f"collision shapes of link {link!r} left out: {problem}")
            return ()

    def _collision(self, link: str, collision: Any) -> Shape:
        mesh = collision.geometry.mesh
        if mesh is not None and self._locator.find(mesh.filename) is None:
            raise RobotMeshError(f"collision {_missing(mesh.filename, link)}")
        return self._shape(link, collision)

    def _shape(self, link: str, element: Any) -> Shape:
        vertices, faces, colors, source = self._surface(element.geometry)
        origin = _transform(element.origin, link, link)
        mesh = SurfaceMesh(link, origin.apply(vertices * MM_PER_M), faces)
        return Shape.with_face_colors(mesh, colors, source)

    def _surface(self, geometry: Any) -> tuple[FloatArray, Any, FloatArray | None, str]:
        """Return vertices in m with scale applied, faces, colours and the source's name."""
        if geometry.box is not None:
            return *primitives.box(geometry.box.size), None, "box"
        if geometry.cylinder is not None:
            shape = geometry.cylinder
            return *primitives.cylinder(shape.radius, shape.length), None, "cylinder"
        if geometry.sphere is not None:
            return *primitives.sphere(geometry.sphere.radius), None, "sphere"
        name = geometry.mesh.filename
        path = self._locator.find(name)
        if path is None:
            raise RobotMeshError(f"mesh {name!r} not found")
        if path not in self._files:
            self._files[path] = read_robot_mesh(path)
        file, scale = self._files[path], _scale(geometry.mesh.scale, name)
        # A mirroring scale turns the surface inside out; reversing the corners restores it.
        faces = file.faces[:, ::-1] if scale.prod() < 0.0 else file.faces
        return file.vertices * scale, faces, file.face_colors, name


def _missing(filename: str, link: str) -> str:
    return (
        f"mesh {filename!r} of link {link!r} not found; add the folder of its package to "
        "package_dirs"
    )


def _named_colors(model: Any) -> dict[str, Rgba]:
    """Colours by material name: those of the robot first, then those defined in visuals."""
    materials = [
        *model.materials,
        *(visual.material for link in model.links for visual in link.visuals if visual.material),
    ]
    colors: dict[str, Rgba] = {}
    for material in materials:
        rgba = _rgba(material)
        if rgba is not None and material.name:
            colors.setdefault(material.name, rgba)
    return colors


def _rgba(material: Any) -> Rgba | None:
    if material.color is None:
        return None
    values = np.asarray(material.color.rgba, dtype=np.float64)
    if values.shape != (4,) or not ((values >= 0.0) & (values <= 1.0)).all():
        raise UrdfError(
            f"color of material {material.name!r} is {values.tolist()}; "
            "expected red, green, blue and alpha from 0 to 1"
        )
    red, green, blue, alpha = values.tolist()
    return red, green, blue, alpha


def _scale(scale: Any, name: str) -> FloatArray:
    values = np.ones(3) if scale is None else np.array(scale, dtype=np.float64)
    if values.shape == ():
        values = np.full(3, values)
    if values.shape != (3,) or not np.isfinite(values).all() or (values == 0.0).any():
        raise RobotMeshError(
            f"scale of mesh {name!r} is {values.tolist()}; expected 3 finite numbers other than 0"
        )
    return values


def _transform(origin: Any, target: str, source: str) -> Transform:
    """Return a URDF origin (m) as a transform in mm, the identity for None."""
    if origin is None:
        return Transform.identity(target, source)
    matrix = np.array(origin, dtype=np.float64)
    matrix[:3, 3] *= MM_PER_M
    return Transform.from_matrix(matrix, target=target, source=source)


def _joint(joint: Any) -> Joint:
    kind = JointType(joint.type)
    lower, upper = -math.inf, math.inf
    if kind in (JointType.REVOLUTE, JointType.PRISMATIC):
        # parse_urdf has checked that joint.limit is not None.
        lower, upper = joint.limit.lower or 0.0, joint.limit.upper or 0.0
    mimic = None
    if joint.mimic is not None and kind is not JointType.FIXED:
        mimic = Mimic(joint.mimic.joint, joint.mimic.multiplier, joint.mimic.offset)
    origin = _transform(joint.origin, joint.parent, joint.child)
    dynamics = _dynamics(joint)
    return Joint(joint.name, kind, origin, joint.axis, lower, upper, mimic, dynamics=dynamics)


def _dynamics(joint: Any) -> JointDynamics:
    limit, losses = joint.limit, joint.dynamics
    return JointDynamics(
        effort=None if limit is None else limit.effort,
        velocity=None if limit is None else limit.velocity,
        damping=0.0 if losses is None else losses.damping or 0.0,
        friction=0.0 if losses is None else losses.friction or 0.0,
    )


def _inertia(link: Any) -> LinkInertia | None:
    found = link.inertial
    if found is None:
        return None
    link_from_inertial = _transform(found.origin, link.name, link.name)
    return LinkInertia(found.mass or 0.0, link_from_inertial, found.inertia)
