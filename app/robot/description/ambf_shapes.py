"""The shapes of AMBF bodies: meshes at two resolutions, boxes, spheres and cylinders.

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
from app.files.packages import split_package_dir
from app.geometry import FloatArray, MeshError, SurfaceMesh
from app.robot.description.adf import AdfSection
from app.robot.description.mesh_locator import MeshLocator
from app.robot.errors import AdfError, RobotMeshError
from app.robot.kinematics.joint import MM_PER_M
from app.robot.meshes import primitives
from app.robot.meshes.mesh_file import read_robot_mesh
from app.robot.shapes import Link, Rgba, Shape

HIGH, LOW = "high resolution path", "low resolution path"


class BodyShapes:
    """Converts bodies to links. Each mesh file is read once; `warnings` lists deviations."""

    def __init__(self, adf: Path, settings: AdfSection, package_dirs: Sequence[str | Path]) -> None:
        self.warnings: list[str] = []
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
        return Link(name, tuple(self._visuals(name, body)), tuple(self._collisions(name, body)))

    def _visuals(self, name: str, body: AdfSection) -> Iterator[Shape]:
        color = self._color(body)
        try:
            if "shape" in body or "compound shape" in body:
                shapes = _primitives(name, body, "shape", "compound shape", "geometry", np.eye(4))
            elif "mesh" in body:
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
            yield from _primitives(
                name, body, "collision shape", "compound collision shape", "collision geometry",
                body.pose(offset),
            )  # fmt: skip
        elif "collision mesh" in body or "mesh" in body:
            file = body.text("collision mesh" if "collision mesh" in body else "mesh")
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
    name: str, body: AdfSection, single: str, compound: str, geometry: str, pose: FloatArray
) -> list[Shape]:
    """Return the single primitive at ``pose`` (m), or those of the compound at their offsets."""
    if single in body:
        return [_primitive(name, body, body.text(single), body.inside(geometry), pose)]
    return [
        _primitive(name, body, entry.text("shape"), entry.inside("geometry"), entry.pose("offset"))
        for entry in body.entries(compound)
    ]


def _primitive(
    name: str, body: AdfSection, kind: str, geometry: AdfSection, pose: FloatArray
) -> Shape:
    match kind.lower():
        case "box":
            vertices, faces = primitives.box(geometry.numbers("xyz").tolist())
        case "sphere":
            vertices, faces = primitives.sphere(geometry.number("radius"))
        case "cylinder":
            vertices, faces = primitives.cylinder(
                geometry.number("radius"), geometry.number("height")
            )
            vertices = vertices @ _z_along(geometry).T
        case _:
            raise RobotMeshError(
                f"{body.place} has the primitive {kind!r}; expected box, sphere or cylinder"
            )
    scale = np.abs(body.scale())  # primitives are symmetric
    vertices = (vertices * scale) @ pose[:3, :3].T + pose[:3, 3]
    return Shape(SurfaceMesh(name, vertices * MM_PER_M, faces.astype(np.int32)), None, kind.lower())


def _z_along(geometry: AdfSection) -> FloatArray:
    """Return the rotation (3, 3) from z to the ``axis`` of the geometry, by default z."""
    axis = geometry.text("axis", "z").lower()
    if axis not in "xyz" or len(axis) != 1:
        raise AdfError(f"{geometry.place}: 'axis' is {axis!r}; expected x, y or z")
    return np.roll(np.eye(3), {"x": 1, "y": 2, "z": 0}[axis], axis=0)


def _joined(folder: str, file: str) -> str:
    return str(PurePosixPath(folder) / file)
