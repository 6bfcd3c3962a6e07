"""World poses of links in the scene, compared with Pinocchio, which reads the same URDF."""

from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
import trimesh
from slicer import vtkMRMLScene

from app.robot import load_robot
from app.scene import MarginGuardScene
from app.scene.convert import world_matrix, world_points
from tests.oracles.pinocchio_kinematics import link_poses, random_positions
from tests.scene.conftest import posed
from tests.scene.scene_content import set_poses

pytestmark = pytest.mark.slow

CONFIGURATIONS = 6
WORLD_MM = 1e-6
BASES = {
    "left": posed("reference", "left_base", [0.3, -0.2, 0.9], [-400.0, 30.0, -20.0]),
    "right": posed("reference", "right_base", [0.0, 0.1, 2.4], [500.0, -80.0, 15.0]),
}
RAS_FROM_REFERENCE = posed("ras", "reference", [0.5, 1.0, -0.3], [17.0, 28.0, -39.0])


class PinocchioRobot:
    """A robot at random configurations within its limits, posed by Pinocchio."""

    def __init__(self, urdf, robot, seed):
        self.model = pin.buildModelFromUrdf(str(urdf))
        self.robot = robot
        self.rng = np.random.default_rng(seed)

    def configure(self):
        """Move to a random configuration; return the positions of the joints without mimic."""
        given, positions = random_positions(self.robot, self.rng)
        self.poses = link_poses(self.model, self.robot, positions)
        return given

    def root_from(self, link):
        """Pose (4, 4) of the link in the root link, in mm."""
        matrix = np.array(self.poses[link].homogeneous)
        matrix[:3, 3] *= 1000.0
        return matrix


def assert_poses_of_pinocchio(model, peer, ras_from_base):
    assert set(model.transforms) == {link.name for link in peer.robot.links}
    for link, node in model.transforms.items():
        expected = ras_from_base @ peer.root_from(link)
        found = world_matrix(node)
        np.testing.assert_allclose(found[:3, 3], expected[:3, 3], rtol=0, atol=WORLD_MM)
        np.testing.assert_allclose(found[:3, :3], expected[:3, :3], rtol=0, atol=1e-9)
    for link, visual in model.models.items():
        assert visual.GetParentTransformNode() is model.transforms[link]
        assert visual.GetName() == f"{link}_model"


def new_scene():
    scene = MarginGuardScene(vtkMRMLScene(), ras_from_reference=RAS_FROM_REFERENCE)
    set_poses(scene, (), BASES.values())
    return scene


def ras_from(side):
    return RAS_FROM_REFERENCE.matrix @ BASES[side].matrix


@pytest.fixture(scope="module")
def ur5(example_urdfs):
    return load_robot(example_urdfs[0])


def test_two_robots_have_the_poses_of_pinocchio(example_urdfs, ur5, project_root):
    scene = new_scene()
    peers = {}
    touch = project_root / "data" / "robots" / "touch" / "touch.urdf"
    robots = (example_urdfs[0], ur5), (touch, load_robot(touch))
    for seed, (side, (urdf, robot)) in enumerate(zip(BASES, robots, strict=True)):
        assert robot.warnings == ()
        peers[side] = PinocchioRobot(urdf, robot, seed)
        scene.add_robot(side, robot, f"{side}_base")
    for _ in range(CONFIGURATIONS):
        with scene.update():
            for side, peer in peers.items():
                links = peer.robot.forward_kinematics(peer.configure())
                scene.robots[side].set_links(links)
        for side, peer in peers.items():
            assert_poses_of_pinocchio(scene.robots[side], peer, ras_from(side))


def test_comparison_detects_a_moved_link(project_root):
    urdf = project_root / "data" / "robots" / "touch" / "touch.urdf"
    robot = load_robot(urdf)
    scene = new_scene()
    model = scene.add_robot("one", robot, "left_base")
    peer = PinocchioRobot(urdf, robot, 3)
    model.set_links(robot.forward_kinematics(peer.configure()))
    moved = ras_from("left")
    moved[0, 3] += 2.0 * WORLD_MM
    with pytest.raises(AssertionError):
        assert_poses_of_pinocchio(model, peer, moved)


def test_visuals_of_a_collada_robot_have_the_bounds_of_pinocchio_and_trimesh(example_urdfs, ur5):
    """Compares bounding boxes per link: meshes read by trimesh, poses by Pinocchio's parser."""
    urdf, robot = example_urdfs[0], ur5
    scene = new_scene()
    model = scene.add_robot("one", robot, "left_base")
    peer = PinocchioRobot(urdf, robot, 4)
    model.set_links(robot.forward_kinematics(peer.configure()))
    packages = [str(urdf.parents[4])]
    visuals = pin.buildGeomFromUrdf(
        peer.model, str(urdf), pin.GeometryType.VISUAL, package_dirs=packages
    )
    placed: dict[str, list[np.ndarray]] = {}
    for visual in visuals.geometryObjects:
        frame = peer.model.frames[visual.parentFrame]
        # Pinocchio gives the poses of visuals and of link frames in the parent joint's frame.
        link_from_visual = frame.placement.actInv(visual.placement)
        points = (
            vertices_m(Path(visual.meshPath)) * visual.meshScale
        ) @ link_from_visual.rotation.T + link_from_visual.translation
        link = ras_from("left") @ peer.root_from(frame.name)
        placed.setdefault(frame.name, []).append(1000.0 * points @ link[:3, :3].T + link[:3, 3])
    assert set(placed) == set(model.models)
    for name, parts in placed.items():
        expected, found = np.concatenate(parts), world_points(model.models[name])
        np.testing.assert_allclose(found.min(axis=0), expected.min(axis=0), atol=1e-3)
        np.testing.assert_allclose(found.max(axis=0), expected.max(axis=0), atol=1e-3)


def vertices_m(path):
    loaded: Any = trimesh.load(path, force="scene")
    return np.asarray(loaded.to_geometry().vertices)
