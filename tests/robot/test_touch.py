"""The project's touch arm: meshes, dimensions, workspace."""

import importlib.util
import itertools

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from app.geometry import Transform
from app.robot import IkOptions


@pytest.fixture(scope="module")
def make_meshes(touch_urdf):
    """The script that makes the meshes, as a module."""
    path = touch_urdf.parent / "make_meshes.py"
    spec = importlib.util.spec_from_file_location("touch_make_meshes", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_committed_meshes_equal_those_of_the_script(make_meshes, touch_urdf, tmp_path):
    make_meshes.write_meshes(tmp_path)
    committed = {path.name: path for path in (touch_urdf.parent / "meshes").iterdir()}
    assert set(committed) == {path.name for path in tmp_path.iterdir()}
    for name, path in committed.items():
        # Compared with a tolerance: the last digit of a sine depends on the machine.
        old, new = trimesh.load_mesh(path, process=False), trimesh.load_mesh(tmp_path / name)
        assert len(old.faces) == len(new.faces), name
        np.testing.assert_allclose(old.triangles, new.triangles, rtol=0, atol=1e-4)


def test_files_of_the_arm_are_small(touch_urdf):
    files = [path for path in touch_urdf.parent.rglob("*") if path.suffix in (".stl", ".urdf")]
    assert sum(path.stat().st_size for path in files) < 600_000


def test_surfaces_are_closed_with_normals_outward(touch):
    for link in touch.links:
        assert link.visuals and link.collisions
        for shape in (*link.visuals, *link.collisions):
            shape.mesh.require_closed(f"{shape.source} of {link.name}")
    assert all(shape.color is not None for link in touch.links for shape in link.visuals)
    assert touch.warnings == ()


def test_collision_shapes_cover_the_visuals(touch):
    """Every vertex of a visual lies in the convex hull of one of the link's collision shapes."""
    for link in touch.links:
        vertices = np.concatenate([shape.mesh.vertices_mm for shape in link.visuals])
        outside = np.full(len(vertices), np.inf)
        for shape in link.collisions:
            hull = trimesh.convex.convex_hull(np.asarray(shape.mesh.vertices_mm))
            beyond = (vertices[:, None] - hull.triangles[:, 0]) * hull.face_normals
            outside = np.minimum(outside, beyond.sum(axis=2).max(axis=1))
        assert outside.max() < 1.0, link.name


def test_links_have_the_lengths_of_an_omni(touch):
    links = touch.forward_kinematics({"waist": 0.3, "shoulder": 0.7, "elbow": -0.4, "yaw": 1.0})
    joint_positions = [links[name].translation_mm for name in ("upper_arm", "forearm", "wrist")]
    for near, far in itertools.pairwise(joint_positions):
        assert np.linalg.norm(far - near) == pytest.approx(133.35)
    np.testing.assert_allclose(links["gimbal"].translation_mm, links["wrist"].translation_mm)
    assert touch.actuated_joint_names == ("waist", "shoulder", "elbow", "yaw", "pitch", "roll")


def test_stylus_frame_is_at_the_tip_with_z_along_the_pen(touch):
    links = touch.forward_kinematics({"waist": 0.2, "pitch": 0.5, "roll": 1.0})
    stylus, gimbal = links["stylus"], links["gimbal"]
    along = stylus.translation_mm - gimbal.translation_mm
    np.testing.assert_allclose(along, 45.0 * stylus.rotation[:, 2], atol=1e-9)
    (pen, *_) = next(link for link in touch.links if link.name == "stylus").visuals
    assert pen.mesh.bounds_mm[1][2] == 0.0
    rolled = touch.forward_kinematics({"waist": 0.2, "pitch": 0.5, "roll": -1.0})["stylus"]
    np.testing.assert_allclose(rolled.translation_mm, stylus.translation_mm, atol=1e-9)


def test_positive_shoulder_and_elbow_raise_and_positive_pitch_lowers(touch):
    def tip(**positions):
        return touch.forward_kinematics(positions)["stylus"].translation_mm

    def wrist(**positions):
        return touch.forward_kinematics(positions)["wrist"].translation_mm

    assert wrist(shoulder=0.1)[2] > wrist()[2]
    assert wrist(elbow=0.1)[2] > wrist()[2]
    assert tip(waist=0.1)[1] > 0.0
    assert tip(pitch=0.1)[2] < tip()[2]


# A cube of 120 mm in front of the arm. The pen points down by 45 degrees, its tip to the base.
CUBE_CENTRE_MM = np.array([130.0, 0.0, 130.0])
DOWN = np.array([-1.0, 0.0, -1.0]) / np.sqrt(2.0)


def test_workspace_contains_a_cube_at_all_tilts_of_the_pen(touch):
    pen = np.column_stack([np.cross((0.0, 1.0, 0.0), DOWN), (0.0, 1.0, 0.0), DOWN])
    axes = np.array([axis for axis in itertools.product((-1, 0, 1), repeat=3) if any(axis)])
    tilts = np.radians(30.0) * axes[::5] / np.linalg.norm(axes[::5], axis=1, keepdims=True)
    options = IkOptions(tolerance_mm=1e-4, tolerance_rad=1e-6)
    limits = {joint.name: (joint.lower, joint.upper) for joint in touch.joints}
    for corner in itertools.product((-60.0, 60.0), repeat=3):
        seed = None
        for tilt in (np.zeros(3), *tilts):
            rotation = Rotation.from_rotvec(tilt).as_matrix() @ pen
            goal = Transform("touch_base", "stylus", rotation, CUBE_CENTRE_MM + corner)
            seed = touch.inverse_kinematics("stylus", goal, seed=seed, options=options)
            for name, (lower, upper) in limits.items():
                assert lower + 0.1 < seed[name] < upper - 0.1, (corner, tilt, name)
            # Away from the gimbal's singularity, where pen and forearm are parallel.
            assert np.cos(seed["pitch"]) > 0.3
