"""The touch arm of our own: its drawing, its proportions, its workspace."""

import importlib.util
import itertools

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from app.geometry import Transform
from app.robot import IkOptions


@pytest.fixture(scope="module")
def draw(touch_urdf):
    """The script that draws the meshes, as a module."""
    path = touch_urdf.parent / "make_meshes.py"
    spec = importlib.util.spec_from_file_location("touch_make_meshes", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_committed_meshes_are_what_the_script_draws(draw, touch_urdf, tmp_path):
    draw.write_meshes(tmp_path)
    committed = {path.name: path for path in (touch_urdf.parent / "meshes").iterdir()}
    assert set(committed) == {path.name for path in tmp_path.iterdir()}
    for name, path in committed.items():
        # Not byte by byte: another machine's sine may differ in its last digit.
        old, new = trimesh.load_mesh(path, process=False), trimesh.load_mesh(tmp_path / name)
        assert len(old.faces) == len(new.faces), name
        np.testing.assert_allclose(old.triangles, new.triangles, rtol=0, atol=1e-4)


def test_the_folder_stays_small(touch_urdf):
    files = [path for path in touch_urdf.parent.rglob("*") if path.suffix in (".stl", ".urdf")]
    assert sum(path.stat().st_size for path in files) < 600_000


def test_all_surfaces_are_closed_with_normals_outward(touch):
    for link in touch.links:
        assert link.visuals and link.collisions
        for shape in (*link.visuals, *link.collisions):
            shape.mesh.require_closed(f"{shape.source} of {link.name}")
    assert all(shape.color is not None for link in touch.links for shape in link.visuals)
    assert touch.warnings == ()


def test_what_collides_covers_what_is_seen(touch):
    """Every vertex that is drawn lies in a convex hull of the link's collision shapes."""
    for link in touch.links:
        seen = np.concatenate([shape.mesh.vertices_mm for shape in link.visuals])
        outside = np.full(len(seen), np.inf)
        for shape in link.collisions:
            hull = trimesh.convex.convex_hull(np.asarray(shape.mesh.vertices_mm))
            beyond = (seen[:, None] - hull.triangles[:, 0]) * hull.face_normals
            outside = np.minimum(outside, beyond.sum(axis=2).max(axis=1))
        assert outside.max() < 1.0, link.name


def test_the_proportions_of_an_omni(touch):
    links = touch.forward_kinematics({"waist": 0.3, "shoulder": 0.7, "elbow": -0.4, "yaw": 1.0})
    joint_places = [links[name].translation_mm for name in ("upper_arm", "forearm", "wrist")]
    for near, far in itertools.pairwise(joint_places):
        assert np.linalg.norm(far - near) == pytest.approx(133.35)
    np.testing.assert_allclose(links["gimbal"].translation_mm, links["wrist"].translation_mm)
    assert touch.actuated_joint_names == ("waist", "shoulder", "elbow", "yaw", "pitch", "roll")


def test_the_stylus_frame_is_the_tip_with_z_out_of_the_pen(touch):
    links = touch.forward_kinematics({"waist": 0.2, "pitch": 0.5, "roll": 1.0})
    stylus, gimbal = links["stylus"], links["gimbal"]
    along = stylus.translation_mm - gimbal.translation_mm
    np.testing.assert_allclose(along, 45.0 * stylus.rotation[:, 2], atol=1e-9)
    (pen, *_) = next(link for link in touch.links if link.name == "stylus").visuals
    assert pen.mesh.bounds_mm[1][2] == 0.0
    rolled = touch.forward_kinematics({"waist": 0.2, "pitch": 0.5, "roll": -1.0})["stylus"]
    np.testing.assert_allclose(rolled.translation_mm, stylus.translation_mm, atol=1e-9)


def test_positive_joints_raise_and_positive_pitch_dips(touch):
    def tip(**positions):
        return touch.forward_kinematics(positions)["stylus"].translation_mm

    def wrist(**positions):
        return touch.forward_kinematics(positions)["wrist"].translation_mm

    assert wrist(shoulder=0.1)[2] > wrist()[2]
    assert wrist(elbow=0.1)[2] > wrist()[2]
    assert tip(waist=0.1)[1] > 0.0
    assert tip(pitch=0.1)[2] < tip()[2]


# A cube of 120 mm in front of the arm, and the pen 45 degrees down with its tip towards the base.
CUBE_CENTRE_MM = np.array([130.0, 0.0, 130.0])
DOWN = np.array([-1.0, 0.0, -1.0]) / np.sqrt(2.0)


def test_the_workspace_holds_a_cube_with_the_pen_tilted_every_way(touch):
    pen = np.column_stack([np.cross((0.0, 1.0, 0.0), DOWN), (0.0, 1.0, 0.0), DOWN])
    axes = np.array([axis for axis in itertools.product((-1, 0, 1), repeat=3) if any(axis)])
    tilts = np.radians(30.0) * axes[::3] / np.linalg.norm(axes[::3], axis=1, keepdims=True)
    options = IkOptions(tolerance_mm=1e-4, tolerance_rad=1e-6)
    limits = {joint.name: (joint.lower, joint.upper) for joint in touch.joints}
    for corner in itertools.product((-60.0, 60.0), repeat=3):
        seed = None
        for tilt in (np.zeros(3), *tilts):
            rotation = Rotation.from_rotvec(tilt).as_matrix() @ pen
            wanted = Transform("touch_base", "stylus", rotation, CUBE_CENTRE_MM + corner)
            seed = touch.inverse_kinematics("stylus", wanted, seed=seed, options=options)
            for name, (lower, upper) in limits.items():
                assert lower + 0.1 < seed[name] < upper - 0.1, (corner, tilt, name)
            # Far from the gimbal's singularity, where pen and forearm are in line.
            assert np.cos(seed["pitch"]) > 0.3
