"""Visuals and collisions of links: formats, scale, colours, missing meshes."""

import numpy as np
import pytest
import trimesh
from trimesh.transformations import translation_matrix

from app.robot import RobotMeshError, load_robot

# An L-shaped body without symmetry: a mirrored or turned one would be seen.
BODY = trimesh.util.concatenate(
    [
        trimesh.creation.box((0.04, 0.02, 0.01)),
        trimesh.creation.box((0.01, 0.01, 0.03), transform=translation_matrix((0.1, 0, 0.02))),
    ]
)
SPHERE = '<sphere radius="1"/>'


def link(*elements, name="a"):
    return f'<link name="{name}">{"".join(elements)}</link>'


def shape(geometry, kind="visual", extra=""):
    return f"<{kind}>{extra}<geometry>{geometry}</geometry></{kind}>"


def mesh(name, scale=None, kind="visual", extra=""):
    attribute = f' scale="{scale}"' if scale else ""
    return shape(f'<mesh filename="{name}"{attribute}/>', kind, extra)


@pytest.fixture
def load(tmp_path, write_urdf):
    """Return a function that loads a robot of one link beside ``body.stl`` and ``body.obj``."""
    BODY.export(tmp_path / "body.stl")
    BODY.export(tmp_path / "body.obj")
    return lambda *elements: load_robot(write_urdf(link(*elements)))


def assert_same_surface(loaded, expected_m):
    """Compare triangles in space, in any order; the corners keep their orientation."""

    def canonical(triangles):
        triangles = np.round(triangles, 3) + 0.0
        first = [min(range(3), key=lambda i: tuple(t[i])) for t in triangles]
        turned = (np.roll(t, -i, axis=0) for t, i in zip(triangles, first, strict=True))
        return sorted(tuple(t.ravel()) for t in turned)

    assert canonical(loaded.triangles_mm) == canonical(1000.0 * expected_m)


@pytest.mark.parametrize("suffix", ["stl", "obj", "dae", "glb", "ply", "STL"])
def test_all_formats_give_the_same_closed_surface(tmp_path, load, suffix):
    name = f"shape.{suffix}"
    BODY.export(tmp_path / name, file_type=suffix.lower())
    robot = load(mesh(name), mesh(name, kind="collision"))
    assert robot.warnings == ()
    (read,) = robot.links
    for loaded in (*read.visuals, *read.collisions):
        assert (loaded.mesh.frame, loaded.source) == ("a", name)
        assert loaded.mesh.require_closed("body")
        assert_same_surface(loaded.mesh, BODY.triangles)


def test_ascii_stl_is_read(tmp_path, load):
    BODY.export(tmp_path / "ascii.stl", file_type="stl_ascii")
    assert_same_surface(load(mesh("ascii.stl")).links[0].visuals[0].mesh, BODY.triangles)


def test_all_visuals_and_collisions_of_a_link_are_read(load):
    (read,) = load(
        mesh("body.stl"),
        shape('<box size="0.1 0.2 0.3"/>'),
        shape('<cylinder radius="0.01" length="0.1"/>'),
        shape('<sphere radius="0.02"/>', "collision"),
        mesh("body.stl", kind="collision"),
    ).links
    assert [each.source for each in read.visuals] == ["body.stl", "box", "cylinder"]
    assert [each.source for each in read.collisions] == ["sphere", "body.stl"]
    np.testing.assert_allclose(read.visuals[1].mesh.bounds_mm[1], [50, 100, 150])


def test_origin_is_applied_after_the_scale(load):
    origin = '<origin xyz="0.1 0 0" rpy="0 0 1.5707963267948966"/>'
    (read,) = load(mesh("body.stl", "2 3 4", extra=origin)).links
    turned = (BODY.triangles * (2, 3, 4))[..., [1, 0, 2]] * (-1, 1, 1)
    assert_same_surface(read.visuals[0].mesh, turned + np.array([0.1, 0, 0]))


@pytest.mark.parametrize("scale", ["-1 1 1", "1 -2 1", "-1 -1 -1", "-1 -1 1", "0.001"])
def test_normals_stay_outward_at_any_scale(load, scale):
    (read,) = load(mesh("body.obj", scale, "collision")).links
    factors = np.array([float(part) for part in scale.split()]) * np.ones(3)
    volume = read.collisions[0].mesh.require_closed("body").signed_volume_mm3
    assert volume == pytest.approx(1e9 * BODY.volume * abs(factors.prod()))


def test_one_file_is_used_at_two_scales(load):
    (read,) = load(mesh("body.stl"), mesh("body.stl", "0.5 0.5 0.5")).links
    big, small = (each.mesh.signed_volume_mm3 for each in read.visuals)
    assert big == pytest.approx(8.0 * small)


def test_mesh_for_display_that_is_missing_or_malformed_is_a_warning(tmp_path, load):
    (tmp_path / "broken.stl").write_bytes(b"not a mesh at all" * 10)
    for name, words in (("package://gone/a.stl", "'a'"), ("broken.stl", "")):
        robot = load(mesh(name), shape(SPHERE))
        assert [each.source for each in robot.links[0].visuals] == ["sphere"]
        (warning,) = robot.warnings
        assert name in warning and words in warning and "\n" not in warning


REFUSED = [
    *(
        (mesh("body.stl", bad, "collision"), "scale of mesh 'body.stl'")
        for bad in ("0 1 1", "1 1", "nan 1 1")
    ),
    (mesh("gone.stl", kind="collision"), "collision mesh 'gone.stl' of link 'a' not found"),
    (mesh("broken.stl", kind="collision"), "broken.stl"),
    *((mesh("package://p/../../x.stl", kind=k), "leaves its") for k in ("visual", "collision")),
    *((mesh("https://example.org/x.stl", kind=k), "scheme") for k in ("visual", "collision")),
]


@pytest.mark.parametrize(("element", "message"), REFUSED)
def test_mesh_for_collision_or_of_an_unsafe_name_is_refused(tmp_path, load, element, message):
    (tmp_path / "broken.stl").write_bytes(b"not a mesh at all" * 10)
    with pytest.raises(RobotMeshError, match=message):
        load(element)


def test_colour_of_the_urdf_overrides_that_of_the_file(tmp_path, write_urdf):
    painted = BODY.copy()
    painted.visual.face_colors = [0, 255, 0, 255]
    painted.export(tmp_path / "green.ply")
    red = '<material name="red"><color rgba="1 0 0 0.5"/></material>'
    # A material defined in a visual is known to the whole robot.
    blue = '<material name="blue"><color rgba="0 0 1 1"/></material>'
    painted_link = link(
        mesh("green.ply"),
        mesh("green.ply", extra='<material name="red"/>'),
        mesh("green.ply", extra='<material name="blue"/>'),
        shape(SPHERE),
    )
    joint = '<joint name="j" type="fixed"><parent link="a"/><child link="b"/></joint>'
    body = red + painted_link + link(shape(SPHERE, extra=blue), name="b") + joint
    colors = [each.color for each in load_robot(write_urdf(body)).links[0].visuals]
    assert colors == [(0, 1, 0, 1), (1, 0, 0, 0.5), (0, 0, 1, 1), None]


def test_package_of_a_robot_is_found_beside_it(tmp_path, write_urdf):
    """``package://arm`` in a folder of another name, by the name in its package.xml."""
    folder = tmp_path / "checkout"
    (folder / "meshes").mkdir(parents=True)
    (folder / "package.xml").write_text("<package><name>arm</name></package>")
    trimesh.creation.box(extents=(0.1, 0.2, 0.3)).export(folder / "meshes" / "box.stl")
    urdf = write_urdf(link(mesh("package://arm/meshes/box.stl")), folder=folder / "urdf")
    for robot in (load_robot(urdf, package_dirs=[folder]), load_robot(urdf)):
        np.testing.assert_allclose(robot.links[0].visuals[0].mesh.bounds_mm[1], [50, 100, 150])


def test_omni_loads_with_and_without_its_package_folder(shared_data):
    urdf = shared_data / "omni" / "urdf" / "omni.urdf"
    given, found = load_robot(urdf, package_dirs=[shared_data / "omni"]), load_robot(urdf)
    for one, other in zip(given.links, found.links, strict=True):
        (visual, *_), (peer, *_) = one.visuals, other.visuals
        assert visual.color == peer.color
        np.testing.assert_array_equal(visual.mesh.vertices_mm, peer.mesh.vertices_mm)
