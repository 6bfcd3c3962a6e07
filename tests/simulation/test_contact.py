"""How deep a pressed tool penetrates, measured by libigl on MuJoCo's own geometry."""

from pathlib import Path

import igl
import numpy as np
import pytest
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
from app.synthetic import cautery_mesh
from tests.simulation.conftest import placed

FORCE_N = 20.0
MAX_DEPTH_MM = 0.1


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
        points = np.concatenate([vertices, surface.sample(2000, seed=1)])
        for other, triangles in geometry(world, body):
            signed, *_ = igl.signed_distance(points, other, triangles)
            deepest = max(deepest, float(-signed.min()))
    return deepest


SLIDE = """<robot name="press">
  <link name="base"/>
  <link name="slide"><inertial><mass value="{mass}"/>
    <inertia ixx="1e-4" ixy="0" ixz="0" iyy="1e-4" iyz="0" izz="1e-4"/></inertial></link>
  <joint name="down" type="prismatic"><parent link="base"/><child link="slide"/>
    <axis xyz="0 0 -1"/><limit lower="-0.1" upper="0.1" effort="{force}" velocity="1"/></joint>
</robot>"""


def press(folder: Path, mass_kg: float) -> World:
    """A slide whose drive gives 20 N, with a tool above the top of the skull, its tip down."""
    file = folder / "press.urdf"
    file.write_text(SLIDE.format(mass=mass_kg, force=FORCE_N))
    mesh = skull()
    top = float(mesh.vertices_mm[:, 2].max())
    highest = mesh.vertices_mm[int(mesh.vertices_mm[:, 2].argmax())]
    turned = Transform.from_rotation_vector(
        (np.pi, 0, 0), np.zeros(3), target="slide", source="tool"
    )
    tool = cautery_mesh()
    held = ToolEntry(
        "tool",
        "slide",
        SurfaceMesh("tool", tool.vertices_mm, tool.faces),
        turned,
        0.02,
        0.3,
        "hull",
    )
    base = placed("base", float(highest[0]), float(highest[1]), top + 1.0)
    body = BodyEntry("skull", mesh, placed("skull", 0, 0, 0), None, collision="parts")
    robot = RobotEntry("press", load_robot(file), base, {}, tool=held)
    return World(WorldDescription("press", 1, gravity_m_s2=0.0, robots=(robot,), bodies=(body,)))


@pytest.mark.parametrize("mass_kg", [0.05, 1.0])
def test_pressed_tool_stays_on_the_surface(tmp_path: Path, mass_kg: float) -> None:
    world = press(tmp_path, mass_kg)
    deepest, touched, pressed = -np.inf, 0, 0
    for step in range(5500):
        state = world.step({"press": JointVelocityCommand(world.time_ns, ("down",), (0.02,))})
        deepest = max([deepest, *(contact.depth_mm for contact in world.contacts())])
        touched += world.data.ncon > 0
        pressed += state.arms["press"].efforts[0] > FORCE_N - 1e-9
        if step % 500 == 499:
            deepest = max(deepest, depth_mm(world, "tool", "skull"))
    assert touched > 5000
    assert pressed > 5000
    assert 0.0 < deepest <= MAX_DEPTH_MM


def test_parts_differ_little_from_the_skull_and_keep_its_opening() -> None:
    mesh = skull()
    body = BodyEntry("skull", mesh, placed("skull", 0, 0, 0), None, collision="parts")
    world = World(WorldDescription("skull", 1, bodies=(body,)))
    surface = trimesh.Trimesh(mesh.vertices_mm, mesh.faces, process=False)
    on_surface = surface.sample(4000, seed=1)
    outside, uncovered = 0.0, np.full(len(on_surface), np.inf)
    for vertices, faces in geometry(world, "skull"):
        points = trimesh.Trimesh(vertices, faces, process=False).sample(500, seed=2)
        signed, *_ = igl.signed_distance(points, mesh.vertices_mm, mesh.faces)
        outside = max(outside, float(signed.max()))
        signed, *_ = igl.signed_distance(on_surface, vertices, faces)
        uncovered = np.minimum(uncovered, signed)
    assert outside < 5.0, "mm; the hull would fill the shell of 70 mm"
    assert uncovered.max() < 0.1, "mm"
