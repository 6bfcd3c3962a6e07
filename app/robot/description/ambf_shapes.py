"""The shapes of AMBF bodies: meshes at two resolutions, boxes, spheres and cylinders.

A mesh is at ``high resolution path`` for display and at ``low resolution path`` for collision, of
the body, else of the file, relative to the file. Files travel without these folders, so a mesh that
is not there is looked for by its name, and by its name under each tail of the path that was said
(``kuka/low_res``, ``low_res``): in ``package_dirs``, in the file's folder, in ``meshes`` beside
it. Display falls back to the low resolution.
"""

from collections.abc import Iterator, Sequence
from pathlib import Path, PurePosixPath

import numpy as np

from app.files.mesh_file import FileMesh
from app.files.packages import split_package_dir
from app.geometry import FloatArray, MeshError, SurfaceMesh
from app.robot.description.adf import Section
from app.robot.description.mesh_locator import MeshLocator
from app.robot.errors import AdfError, RobotMeshError
from app.robot.kinematics.joint import MM_PER_M
from app.robot.meshes import primitives
from app.robot.meshes.mesh_file import read_robot_mesh
from app.robot.shapes import Link, Rgba, Shape

HIGH, LOW = "high resolution path", "low resolution path"


class BodyShapes:
    """Bodies to links; a mesh file is read once, `warnings` says what differs from the file."""

    def __init__(self, adf: Path, settings: Section, package_dirs: Sequence[str | Path]) -> None:
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

    def link(self, name: str, body: Section) -> Link:
        """The body's visuals and collisions in its own frame, mm."""
        body.scale()  # checked where the body has no shape as well
        return Link(name, tuple(self._visuals(name, body)), tuple(self._collisions(name, body)))

    def _visuals(self, name: str, body: Section) -> Iterator[Shape]:
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

    def _collisions(self, name: str, body: Section) -> Iterator[Shape]:
        if "collision shape" in body or "compound collision shape" in body:
            offset = "collision offset" if "collision offset" in body else "inertial offset"
            yield from _primitives(
                name, body, "collision shape", "compound collision shape", "collision geometry",
                body.pose(offset),
            )  # fmt: skip
        elif "collision mesh" in body or "mesh" in body:
            file = body.text("collision mesh" if "collision mesh" in body else "mesh")
            yield self._mesh(name, body, file, (LOW, HIGH))

    def _mesh(self, name: str, body: Section, file: str, roles: Sequence[str]) -> Shape:
        path, source = self._find(name, body, file, roles)
        if path not in self._files:
            self._files[path] = read_robot_mesh(path)
        mesh, scale = self._files[path], body.scale()
        # A scale that mirrors turns the surface inside out; so does swapping two corners.
        faces = mesh.faces[:, ::-1] if scale.prod() < 0.0 else mesh.faces
        surface = SurfaceMesh(name, mesh.vertices * scale * MM_PER_M, faces.astype(np.int32))
        return Shape.of(surface, mesh.face_colors, source)

    def _find(self, name: str, body: Section, file: str, roles: Sequence[str]) -> tuple[Path, str]:
        """The file of a mesh and the name that it was found by, the said place first."""
        said = [
            str(section.values[role])
            for role in roles
            for section in (body, self._settings)
            if role in section
        ] or [""]
        first = _joined(said[0], file)
        found = self._locator.find(first)
        if found is not None:
            return found, first
        for place in said:
            for other in (_joined(place, file), *self._elsewhere(place, file)):
                found = self._locator.find(other)
                if found is not None:
                    self.warnings.append(
                        f"mesh {first!r} of body {name!r} not found: {other!r} taken"
                    )
                    return found, other
        raise RobotMeshError(
            f"mesh {first!r} of body {name!r} not found: name its folder in package_dirs, or put "
            "it in a folder 'meshes' beside the file"
        )

    def _elsewhere(self, place: str, file: str) -> Iterator[str]:
        parts = [part for part in PurePosixPath(place).parts if part not in ("..", ".", "/")]
        for base in self._bases:
            for start in range(len(parts) + 1):
                yield str((base / Path(*parts[start:]) / file).absolute())

    def _color(self, body: Section) -> Rgba | None:
        if "color rgba" in body:
            rgba = body.inside("color rgba")
            red, green, blue = rgba.numbers("rgb").tolist()
            alpha = rgba.number("a", 1.0)
        elif "color components" in body:
            components = body.inside("color components")
            red, green, blue = components.inside("diffuse").numbers("rgb").tolist()
            alpha = components.number("transparency", 1.0)  # 1 is opaque, as the simulator has it
        else:
            if "color" in body:
                self.warnings.append(
                    f"color {body.values['color']!r} of {body.place} is a name of the simulator's: "
                    "not shown"
                )
            return None
        if not all(0.0 <= value <= 1.0 for value in (red, green, blue, alpha)):
            raise AdfError(f"{body.place} has the color {[red, green, blue, alpha]}: 0 to 1 wanted")
        return red, green, blue, alpha


def _primitives(
    name: str, body: Section, single: str, compound: str, geometry: str, pose: FloatArray
) -> list[Shape]:
    """The one primitive at ``pose`` (m), or those of the compound, each at its own offset."""
    if single in body:
        return [_primitive(name, body, body.text(single), body.inside(geometry), pose)]
    return [
        _primitive(name, body, entry.text("shape"), entry.inside("geometry"), entry.pose("offset"))
        for entry in body.entries(compound)
    ]


def _primitive(name: str, body: Section, kind: str, geometry: Section, pose: FloatArray) -> Shape:
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
                f"{body.place} has the primitive {kind!r}: box, sphere or cylinder wanted"
            )
    scale = np.abs(body.scale())  # primitives are symmetric
    vertices = (vertices * scale) @ pose[:3, :3].T + pose[:3, 3]
    return Shape(SurfaceMesh(name, vertices * MM_PER_M, faces.astype(np.int32)), None, kind.lower())


def _z_along(geometry: Section) -> FloatArray:
    """The rotation that turns z to the ``axis`` of the geometry, z where it says none."""
    axis = geometry.text("axis", "z").lower()
    if axis not in "xyz" or len(axis) != 1:
        raise AdfError(f"{geometry.place}: 'axis' is {axis!r}: x, y or z wanted")
    return np.roll(np.eye(3), {"x": 1, "y": 2, "z": 0}[axis], axis=0)


def _joined(place: str, file: str) -> str:
    return str(PurePosixPath(place) / file)
