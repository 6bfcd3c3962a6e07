"""A tool that is pressed on a skull: how deep it penetrates, by libigl on MuJoCo's own geometry.

The error of the convex parts, which collide instead of the surface, is measured apart.
"""

from dataclasses import dataclass
from pathlib import Path

import igl
import numpy as np
import trimesh
from scipy.spatial import ConvexHull

from app.geometry import FloatArray, SurfaceMesh, Transform
from app.robot import load_robot
from app.simulation import (
    BodyEntry,
    JointVelocityCommand,
    RobotEntry,
    ToolEntry,
    World,
    WorldDescription,
)
from app.synthetic import tool_mesh

FORCE_N = 20.0
PRESS_S = 5.0
MAX_DEPTH_MM = 0.1
MASSES_KG = (0.05, 1.0)
"""Masses of the slide that presses: one arrives softly, the other with a blow."""

_APPROACH_M_S = 0.02
_FALL_STEPS = 500
_LIBIGL_STEPS = 500
_SURFACE_POINTS = 2000

_SLIDE = """<robot name="press">
  <link name="base"/>
  <link name="slide"><inertial><mass value="{mass}"/>
    <inertia ixx="1e-4" ixy="0" ixz="0" iyy="1e-4" iyz="0" izz="1e-4"/></inertial></link>
  <joint name="down" type="prismatic"><parent link="base"/><child link="slide"/>
    <axis xyz="0 0 -1"/><limit lower="-0.1" upper="0.1" effort="{force}" velocity="1"/></joint>
</robot>"""


@dataclass(frozen=True, slots=True)
class Press:
    """A press of `PRESS_S` with `FORCE_N` by a slide of ``mass_kg``; depths in mm.

    ``contact_mm`` is the deepest contact of all steps by MuJoCo, ``impact_mm`` the deepest by
    libigl in the steps whose contact is deeper than all before, ``rest_mm`` in steps
    `_LIBIGL_STEPS` apart. ``pressed_s``: how long the drive gave its full force.
    """

    mass_kg: float
    contact_mm: float
    impact_mm: float
    rest_mm: float
    pressed_s: float

    @property
    def is_good(self) -> bool:
        """True if the tool touched, was pressed and stayed within `MAX_DEPTH_MM`."""
        deepest = max(self.contact_mm, self.impact_mm, self.rest_mm)
        return 0.0 < deepest <= MAX_DEPTH_MM and self.pressed_s >= PRESS_S


def skull() -> SurfaceMesh:
    """A closed shell with an opening: two bumpy spheres, cut by a plane."""
    outer = trimesh.creation.icosphere(subdivisions=3, radius=80.0)
    direction = outer.vertices / 80.0
    outer.vertices *= (1.0 + 0.03 * np.sin(5.0 * direction[:, 0]) * np.cos(4.0 * direction[:, 1]))[
        :, None
    ]
    inner = outer.copy()
    inner.vertices *= 0.88
    shell = trimesh.boolean.difference([outer, inner], engine="manifold")
    opening = trimesh.creation.box((300, 300, 100))
    opening.apply_translation((0, 0, -80))
    shell = trimesh.boolean.difference([shell, opening], engine="manifold")
    return SurfaceMesh("skull", shell.vertices, shell.faces)


def run_press(folder: Path, mass_kg: float) -> Press:
    """Press the tool on the skull; ``folder`` receives the robot's file."""
    world = press_world(folder, mass_kg)
    deepest = impact = rest = -np.inf
    pressed = 0
    for step in range(round(PRESS_S * 1000.0) + _FALL_STEPS):
        command = JointVelocityCommand(world.time_ns, ("down",), (_APPROACH_M_S,))
        state = world.step({"press": command})
        contact = max((each.depth_mm for each in world.contacts()), default=-np.inf)
        if contact > deepest:
            deepest = contact
            impact = max(impact, depth_mm(world, "tool", "skull"))
        pressed += state.arms["press"].efforts[0] > FORCE_N - 1e-9
        if step % _LIBIGL_STEPS == _LIBIGL_STEPS - 1:
            rest = max(rest, depth_mm(world, "tool", "skull"))
    return Press(mass_kg, deepest, impact, rest, pressed / 1000.0)


def press_world(folder: Path, mass_kg: float) -> World:
    """A slide whose drive gives 20 N, with a tool above the top of the skull, its tip down."""
    file = folder / "press.urdf"
    file.write_text(_SLIDE.format(mass=mass_kg, force=FORCE_N))
    mesh = skull()
    highest = mesh.vertices_mm[int(mesh.vertices_mm[:, 2].argmax())]
    turned = Transform.from_rotation_vector(
        (np.pi, 0, 0), np.zeros(3), target="slide", source="tool"
    )
    tool = tool_mesh()
    surface = SurfaceMesh("tool", tool.vertices_mm, tool.faces)
    held = ToolEntry("tool", "slide", surface, turned, 0.02, 0.3, "hull")
    base = Transform("world", "base", np.eye(3), highest + np.array([0.0, 0.0, 1.0]))
    robot = RobotEntry("press", load_robot(file), base, {}, tool=held)
    return World(
        WorldDescription("press", 1, gravity_m_s2=0.0, robots=(robot,), bodies=(_fixed(mesh),))
    )


def convex_error_mm() -> tuple[float, float]:
    """By how much convex parts stand out of the skull's surface, and leave it uncovered, in mm."""
    mesh = skull()
    world = World(WorldDescription("skull", 1, bodies=(_fixed(mesh),)))
    surface = trimesh.Trimesh(mesh.vertices_mm, mesh.faces, process=False)
    on_surface = surface.sample(2 * _SURFACE_POINTS, seed=1)
    outside, uncovered = 0.0, np.full(len(on_surface), np.inf)
    for vertices, faces in geometry(world, "skull"):
        points = trimesh.Trimesh(vertices, faces, process=False).sample(500, seed=2)
        signed, *_ = igl.signed_distance(points, mesh.vertices_mm, mesh.faces)
        outside = max(outside, float(signed.max()))
        signed, *_ = igl.signed_distance(on_surface, vertices, faces)
        uncovered = np.minimum(uncovered, signed)
    return outside, float(uncovered.max())


def geometry(world: World, body: str) -> list[tuple[FloatArray, np.ndarray]]:
    """Vertices (n, 3) in mm in the world, and faces, of each convex part that collides."""
    model, data = world.model, world.data
    found = []
    for geom in np.flatnonzero(model.geom_bodyid == model.body(body).id).tolist():
        mesh = model.geom_dataid[geom]
        start, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
        local = model.mesh_vert[start : start + count].astype(np.float64)
        vertices = local @ data.geom_xmat[geom].reshape(3, 3).T + data.geom_xpos[geom]
        hull = trimesh.Trimesh(1000.0 * vertices, ConvexHull(vertices).simplices, process=False)
        hull.fix_normals()
        found.append((np.asarray(hull.vertices), np.asarray(hull.faces)))
    return found


def depth_mm(world: World, tool: str, body: str) -> float:
    """Largest depth of the tool's surface points in any part of the body, by libigl."""
    deepest = -np.inf
    for vertices, faces in geometry(world, tool):
        surface = trimesh.Trimesh(vertices, faces, process=False)
        points = np.concatenate([vertices, surface.sample(_SURFACE_POINTS, seed=1)])
        for other, triangles in geometry(world, body):
            signed, *_ = igl.signed_distance(points, other, triangles)
            deepest = max(deepest, float(-signed.min()))
    return deepest


def _fixed(mesh: SurfaceMesh) -> BodyEntry:
    origin = Transform("world", mesh.frame, np.eye(3), np.zeros(3))
    return BodyEntry("skull", mesh, origin, None, collision="parts")
