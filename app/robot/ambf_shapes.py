"""The shapes of AMBF bodies: meshes at two resolutions, and primitives.

A mesh is at ``high resolution path`` for display and at ``low resolution path`` for collision. The
paths of the body precede those of the file and are relative to the file. ADF files are often copied
without these folders. So a missing mesh is looked for by its name, also under each tail of the
path (``kuka/low_res``, ``low_res``), in ``package_dirs``, in the file's folder and in ``meshes``
beside the file. A missing mesh for display is replaced by that of low resolution.
"""

from collections.abc import Iterator, Sequence
from pathlib import Path, PurePosixPath

import numpy as np

from app.files.mesh_file import FileMesh
from app.files.paths import split_package_dir
from app.geometry import FloatArray, MeshError, SurfaceMesh
from app.robot import primitives
from app.robot.adf import AdfSection
from app.robot.ambf_joints import shortest_rotation
from app.robot.elements import MM_PER_M, AdfError, Link, Rgba, RobotMeshError, Shape
from app.robot.mesh_locator import MeshLocator, read_robot_mesh

HIGH, LOW = "high resolution path", "low resolution path"

PLANE_M, PLANE_DEPTH_M = 10.0, 0.1
"""Width and thickness of the slab that stands for an infinite plane."""


class BodyShapes:
    """Converts bodies to links. Each mesh file is read once; `warnings` lists deviations."""

    def __init__(
        self,
        adf: Path,
        settings: AdfSection,
        package_dirs: Sequence[str | Path],
        require_meshes: bool = True,
    ) -> None:
        self.warnings: list[str] = []
        self.without_collision: list[str] = []
        self._require_meshes = require_meshes
        self._locator = MeshLocator(adf, package_dirs)
        self._settings = settings
        folder = adf.parent
        self._bases = (
            *(split_package_dir(entry)[1] for entry in package_dirs),
            folder,
            folder / "meshes",
        )
        self._files: dict[Path, FileMesh] = {}

    def link(self, name: str, body: AdfSection) -> Link:
        """Return the link of a body, with shapes in the body's frame, in mm."""
        body.scale()  # check it also for a body without shapes
        visuals = tuple(self._visuals(name, body))
        try:
            return Link(name, visuals, tuple(self._collisions(name, body)))
        except (RobotMeshError, MeshError) as problem:
            if self._require_meshes:
                raise
            self.without_collision.append(name)
            self.warnings.append(f"collision shapes of body {name!r} left out: {problem}")
            return Link(name, visuals)

    def _visuals(self, name: str, body: AdfSection) -> Iterator[Shape]:
        color = self._color(body)
        try:
            if "shape" in body or "compound shape" in body:
                shapes = self._primitives(
                    name, body, "shape", "compound shape", "geometry", np.eye(4)
                )
            elif _has_mesh(body, "mesh"):
                file = body.text("mesh")
                shapes = [self._mesh(name, body, file, (HIGH, LOW))]
            else:
                return
        except (RobotMeshError, MeshError) as problem:
            self.warnings.append(f"display of body {name!r} left out: {problem}")
            return
        for shape in shapes:
            yield shape if color is None else Shape(shape.mesh, color, shape.source)

    def _collisions(self, name: str, body: AdfSection) -> Iterator[Shape]:
        if "collision shape" in body or "compound collision shape" in body:
            offset = "collision offset" if "collision offset" in body else "inertial offset"
            yield from self._primitives(
                name, body, "collision shape", "compound collision shape", "collision geometry",
                body.pose(offset),
            )  # fmt: skip
        elif _has_mesh(body, "collision mesh") or _has_mesh(body, "mesh"):
            has_own = _has_mesh(body, "collision mesh")
            file = body.text("collision mesh" if has_own else "mesh")
            yield self._mesh(name, body, file, (LOW, HIGH))

    def _mesh(self, name: str, body: AdfSection, file: str, roles: Sequence[str]) -> Shape:
        path, source = self._find(name, body, file, roles)
        if path not in self._files:
            self._files[path] = read_robot_mesh(path)
        mesh, scale = self._files[path], body.scale()
        # A mirroring scale turns the surface inside out; reversing the corners restores it.
        faces = mesh.faces[:, ::-1] if scale.prod() < 0.0 else mesh.faces
        surface = SurfaceMesh(name, mesh.vertices * scale * MM_PER_M, faces.astype(np.int32))
        return Shape.with_face_colors(surface, mesh.face_colors, source)

    def _find(
        self, name: str, body: AdfSection, file: str, roles: Sequence[str]
    ) -> tuple[Path, str]:
        """Return the file of a mesh and the name that found it, the given path first."""
        folders = [
            str(section.values[role])
            for role in roles
            for section in (body, self._settings)
            if role in section
        ] or [""]
        first = _joined(folders[0], file)
        found = self._locator.find(first)
        if found is not None:
            return found, first
        for folder in folders:
            for other in (_joined(folder, file), *self._alternative_names(folder, file)):
                found = self._locator.find(other)
                if found is not None:
                    self.warnings.append(
                        f"mesh {first!r} of body {name!r} not found: {other!r} used instead"
                    )
                    return found, other
        raise RobotMeshError(
            f"mesh {first!r} of body {name!r} not found; add its folder to package_dirs, or put it "
            "in a folder 'meshes' beside the file"
        )

    def _alternative_names(self, folder: str, file: str) -> Iterator[str]:
        parts = [part for part in PurePosixPath(folder).parts if part not in ("..", ".", "/")]
        for base in self._bases:
            for start in range(len(parts) + 1):
                yield str((base / Path(*parts[start:]) / file).absolute())

    def _color(self, body: AdfSection) -> Rgba | None:
        if "color rgba" in body:
            rgba = body.inside("color rgba")
            red, green, blue = rgba.numbers("rgb").tolist()
            alpha = rgba.number("a", 1.0)
        elif "color components" in body:
            components = body.inside("color components")
            red, green, blue = components.inside("diffuse").numbers("rgb").tolist()
            alpha = components.number("transparency", 1.0)  # 1 is opaque in AMBF
        else:
            if "color" in body:
                self.warnings.append(
                    f"color {body.values['color']!r} of {body.place} is a name that only the "
                    "simulator knows: not used"
                )
            return None
        if not all(0.0 <= value <= 1.0 for value in (red, green, blue, alpha)):
            raise AdfError(
                f"{body.place} has the color {[red, green, blue, alpha]}; expected 0 to 1"
            )
        return red, green, blue, alpha

    def _primitives(
        self,
        name: str,
        body: AdfSection,
        single: str,
        compound: str,
        geometry: str,
        pose: FloatArray,
    ) -> list[Shape]:
        """Return the primitive at ``pose`` (m), or those of the compound at their offsets."""
        if single in body:
            return [self._primitive(name, body, body.text(single), body.inside(geometry), pose)]
        return [
            self._primitive(
                name, body, entry.text("shape"), entry.inside("geometry"), entry.pose("offset")
            )
            for entry in body.entries(compound)
        ]

    def _primitive(
        self, name: str, body: AdfSection, kind: str, geometry: AdfSection, pose: FloatArray
    ) -> Shape:
        kind, scale = kind.lower(), body.scale()
        match kind:
            case "box":
                vertices, faces = primitives.box(geometry.numbers("xyz").tolist())
            case "sphere":
                vertices, faces = primitives.sphere(geometry.number("radius"))
            case "cylinder" | "cone" | "capsule":
                build = getattr(primitives, kind)
                vertices, faces = build(geometry.number("radius"), geometry.number("height"))
                vertices = vertices @ _z_along(geometry).T
            case "plane":
                self.warnings.append(
                    f"{body.place}: a plane is infinite; it is a slab of {PLANE_M:g} m below it"
                )
                vertices, faces = _plane(geometry)
            case _:
                raise RobotMeshError(
                    f"{body.place} has the primitive {kind!r}; expected box, sphere, cylinder, "
                    "cone, capsule or plane"
                )
        if scale.prod() < 0.0:  # a mirrored surface is inside out
            faces = faces[:, ::-1]
        vertices = (vertices * scale) @ pose[:3, :3].T + pose[:3, 3]
        mesh = SurfaceMesh(name, vertices * MM_PER_M, faces.astype(np.int32))
        return Shape(mesh, None, kind)


def _has_mesh(body: AdfSection, key: str) -> bool:
    """True if the body names a mesh file; an empty name means none, as in the simulator."""
    return key in body and body.values[key] != ""


def _plane(geometry: AdfSection) -> primitives.Surface:
    """A slab (m) whose top is the plane at ``offset`` (m) along its ``normal``."""
    normal = np.array([0.0, 0.0, 1.0])
    if "normal" in geometry:
        normal = geometry.inside("normal").numbers("xyz")
    length = float(np.linalg.norm(normal))
    if not 1e-9 <= length < np.inf:
        raise AdfError(f"{geometry.place}: 'normal' is {normal.tolist()}; expected a direction")
    vertices, faces = primitives.box((PLANE_M, PLANE_M, PLANE_DEPTH_M))
    vertices[:, 2] += geometry.number("offset", 0.0) - PLANE_DEPTH_M / 2.0
    return vertices @ shortest_rotation(np.array([0.0, 0.0, 1.0]), normal / length).T, faces


def _z_along(geometry: AdfSection) -> FloatArray:
    """Return the rotation (3, 3) from z to the ``axis`` of the geometry, by default z."""
    axis = geometry.text("axis", "z").lower()
    if axis not in "xyz" or len(axis) != 1:
        raise AdfError(f"{geometry.place}: 'axis' is {axis!r}; expected x, y or z")
    return np.roll(np.eye(3), {"x": 1, "y": 2, "z": 0}[axis], axis=0)


def _joined(folder: str, file: str) -> str:
    return str(PurePosixPath(folder) / file)
