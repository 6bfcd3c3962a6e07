"""Bodies of a collision model: links, what they carry, structures; and their compiled form."""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError

from app.fixture.surfaces.surface import build_bvh
from app.fixture.surfaces.winding_number import Dipoles, dipoles_of, winding_numbers
from app.geometry import FloatArray, FrameError, InputError, SurfaceMesh
from app.planning.collision_distance import Bodies
from app.planning.collision_kernel import Arm
from app.robot import Robot


class Body:
    """A surface in the frame of a link, with its tree, and points and a solid for containment."""

    def __init__(self, name: str, link: str, mesh: SurfaceMesh) -> None:
        self.name, self.link, self.mesh = name, link, mesh
        self.bvh = build_bvh(mesh)
        _, first = np.unique(self.bvh.part, return_index=True)
        self.part_points = self.bvh.corners[first, 0]
        self.hull = _hull_of(mesh.vertices_mm)
        self.solid = _solid_of(mesh, self.hull)

    def contains_any(self, points: FloatArray) -> bool:
        """True if one of ``points`` (n, 3) in the frame of the link is inside."""
        return bool((winding_numbers(self.solid, points) != 0).any())


def _hull_of(points: FloatArray) -> FloatArray:
    """The corners of the convex hull of ``points`` (n, 3); all points if Qhull finds none.

    Qhull leaves out corners of a plate that is nearly flat. So it gets the points stretched to the
    same extent in all directions, which changes no corner.
    """
    stretched = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)[0]
    try:
        return np.asarray(points[ConvexHull(stretched).vertices], np.float64)
    except QhullError:
        return points


def _solid_of(mesh: SurfaceMesh, hull: FloatArray) -> Dipoles:
    """The surface if it is closed, else its convex hull: an open one has no inside.

    The hull of a flat surface has no inside either: it is the surface with its back.
    """
    if mesh.open_edges():
        try:
            solid = ConvexHull(hull)
        except QhullError:
            faces = np.concatenate([mesh.faces, mesh.faces[:, ::-1]])
            mesh = SurfaceMesh(mesh.frame, mesh.vertices_mm, faces)
        else:
            a, b, c = hull[solid.simplices].swapaxes(0, 1)
            outward = (np.cross(b - a, c - a) * solid.equations[:, :3]).sum(axis=1) > 0.0
            faces = np.where(outward[:, None], solid.simplices, solid.simplices[:, ::-1])
            mesh = SurfaceMesh(mesh.frame, hull, faces)
    return dipoles_of(build_bvh(mesh))


def link_bodies(robot: Robot) -> list[Body]:
    """Bodies of the links with collision meshes; raises `InputError` if these are not complete."""
    if robot.dependent_joint_names:
        raise InputError(
            f"robot {robot.name!r}: joint {robot.dependent_joint_names[0]!r} closes a loop; "
            "expected a tree of links"
        )
    if robot.links_without_collision:
        raise InputError(
            f"robot {robot.name!r}: link {robot.links_without_collision[0]!r} has no readable "
            "collision mesh; expected one"
        )
    bodies = []
    for link in robot.links:
        if link.collisions:
            meshes = [shape.mesh for shape in link.collisions]
            bodies.append(Body(link.name, link.name, _joined(meshes)))
    if not bodies:
        raise InputError(f"robot {robot.name!r}: no link has a collision mesh; expected some")
    return bodies


def carried_bodies(robot: Robot, carried: Mapping[str, SurfaceMesh]) -> list[Body]:
    """Bodies in the frames of links; raises `FrameError` for another frame."""
    for name, mesh in carried.items():
        if mesh.frame not in robot.tree.link_rows:
            raise FrameError(
                f"body {name!r}: is in {mesh.frame!r}; expected a link of the robot: "
                f"{', '.join(robot.tree.link_names)}"
            )
    return [Body(name, mesh.frame, mesh) for name, mesh in carried.items()]


def structure(robot: Robot, name: str, mesh: SurfaceMesh) -> Body:
    """A closed surface in the root's frame; raises `FrameError` and `MeshError`."""
    if mesh.frame != robot.root_link:
        raise FrameError(
            f"structure {name!r}: is in {mesh.frame!r}; expected the robot's root "
            f"{robot.root_link!r}"
        )
    mesh.require_closed(f"structure {name!r}")
    return Body(name, mesh.frame, mesh)


def _joined(meshes: list[SurfaceMesh]) -> SurfaceMesh:
    offsets = np.cumsum([0, *(len(mesh.vertices_mm) for mesh in meshes[:-1])])
    return SurfaceMesh(
        meshes[0].frame,
        np.concatenate([mesh.vertices_mm for mesh in meshes]),
        np.concatenate([mesh.faces + at for mesh, at in zip(meshes, offsets, strict=True)]),
    )


def packed(bodies: Sequence[Body], rows: Mapping[str, int]) -> Bodies:
    """The compiled form of ``bodies``; ``rows`` are the numbers of the links."""
    counts = np.array([len(body.bvh.corners) for body in bodies], np.int64)
    nodes = [_nodes(body.bvh.boxes) for body in bodies]
    firsts = [np.cumsum([0, *sizes])[:-1] for sizes in (counts, [len(each) for each in nodes])]
    corners = np.concatenate([body.bvh.corners for body in bodies])
    centers = corners.mean(axis=1)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    radii = np.linalg.norm(corners - centers[:, None], axis=2).max(axis=1)
    return Bodies(
        corners,
        np.column_stack([centers, radii]),
        normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300),
        np.concatenate(nodes),
        np.column_stack(firsts).astype(np.int64),
        counts,
        np.array([body.bvh.levels for body in bodies], np.int64),
        np.array([rows[body.link] for body in bodies], np.int64),
        np.concatenate([body.hull for body in bodies]),
        np.cumsum([0, *(len(body.hull) for body in bodies)]).astype(np.int64),
    )


def _nodes(boxes: FloatArray) -> FloatArray:
    """Sphere, axes and half extents (n, 16) of the boxes (n, 15) of a BVH."""
    axes, low, high = boxes[:, :9].reshape(-1, 3, 3), boxes[:, 9:12], boxes[:, 12:]
    half = 0.5 * (high - low)
    center = np.einsum("nki,nk->ni", axes, 0.5 * (low + high))
    return np.column_stack([center, np.linalg.norm(half, axis=1), boxes[:, :9], half])


def arm(robot: Robot, joints: tuple[str, ...], held: Mapping[str, float]) -> Arm:
    """The compiled form of ``robot``, with positions of ``joints`` as states and others held."""
    tree = robot.tree
    (slides, origins, motions, parents), _ = tree.compiled_arrays(tree.root, ())
    at_zero = robot.complete_positions({**held, **dict.fromkeys(joints, 0.0)})
    base = np.array([at_zero.get(joint.name, 0.0) for joint in tree.joints])
    driver: NDArray[np.int64] = np.full(len(base), -1, np.int64)
    gain = np.zeros(len(base))
    for k, joint in enumerate(tree.joints):
        if joint.moves:
            name, factor = tree.driver_of(joint)
            if name in joints and factor != 0.0:
                driver[k], gain[k] = joints.index(name), factor
    axes = np.array([joint.axis for joint in tree.joints]).reshape(-1, 3)
    pivots = np.array([joint.pivot_mm for joint in tree.joints]).reshape(-1, 3)
    return Arm(slides, origins, motions, parents, base, driver, gain, axes, pivots)
