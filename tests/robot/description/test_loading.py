"""Visuals and collisions of links: formats, scale, colours, missing meshes."""

import numpy as np
import pytest
import trimesh

from app.robot import RobotMeshError, load_robot

# An L-shaped body without symmetry: a mirrored or turned one would be seen.
BODY = trimesh.util.concatenate(
    [
        trimesh.creation.box((0.04, 0.02, 0.01)),
        trimesh.creation.box(
            (0.01, 0.01, 0.03), transform=trimesh.transformations.translation_matrix((0.1, 0, 0.02))
        ),
    ]
)


def link(*elements, name="a"):
    return f'<link name="{name}">{"".join(elements)}</link>'


def shape(geometry, kind="visual", extra=""):
    return f"<{kind}>{extra}<geometry>{geometry}</geometry></{kind}>"


def mesh(name, scale=None):
    attribute = f' scale="{scale}"' if scale else ""
    return f'<mesh filename="{name}"{attribute}/>'


def assert_same_surface(loaded, expected_mm):
    """Compare triangles in space, in any order; the corners keep their orientation."""

    def canonical(triangles):
        triangles = np.round(triangles, 3) + 0.0
        first = [min(range(3), key=lambda i: tuple(t[i])) for t in triangles]
        return sorted(
            tuple(np.roll(t, -i, axis=0).ravel()) for t, i in zip(triangles, first, strict=True)
        )

    assert canonical(loaded.triangles_mm) == canonical(expected_mm)


@pytest.mark.parametrize("suffix", ["stl", "obj", "dae", "glb", "ply", "STL"])
def test_all_formats_give_the_same_closed_surface(tmp_path, write_urdf, suffix):
    BODY.export(tmp_path / f"body.{suffix}", file_type=suffix.lower())
    robot = load_robot(
        write_urdf(link(shape(mesh(f"body.{suffix}")), shape(mesh(f"body.{suffix}"), "collision")))
    )
    assert robot.warnings == ()
    (read,) = robot.links
    for loaded in (*read.visuals, *read.collisions):
        assert loaded.mesh.frame == "a"
        assert loaded.source == f"body.{suffix}"
        assert loaded.mesh.require_closed("body")
        assert_same_surface(loaded.mesh, 1000.0 * BODY.triangles)


def test_ascii_stl_is_read(tmp_path, write_urdf):
    BODY.export(tmp_path / "body.stl", file_type="stl_ascii")
    (read,) = load_robot(write_urdf(link(shape(mesh("body.stl"))))).links
    assert_same_surface(read.visuals[0].mesh, 1000.0 * BODY.triangles)


def test_all_visuals_and_collisions_of_a_link_are_read(tmp_path, write_urdf):
    BODY.export(tmp_path / "body.stl")
    (read,) = load_robot(
        write_urdf(
            link(
                shape(mesh("body.stl")),
                shape('<box size="0.1 0.2 0.3"/>'),
                shape('<cylinder radius="0.01" length="0.1"/>'),
                shape('<sphere radius="0.02"/>', "collision"),
                shape(mesh("body.stl"), "collision"),
            )
        )
    ).links
    assert [each.source for each in read.visuals] == ["body.stl", "box", "cylinder"]
    assert [each.source for each in read.collisions] == ["sphere", "body.stl"]
    np.testing.assert_allclose(read.visuals[1].mesh.bounds_mm[1], [50, 100, 150])


def test_origin_is_applied_after_the_scale(tmp_path, write_urdf):
    BODY.export(tmp_path / "body.stl")
    origin = '<origin xyz="0.1 0 0" rpy="0 0 1.5707963267948966"/>'
    (read,) = load_robot(write_urdf(link(shape(mesh("body.stl", "2 3 4"), extra=origin)))).links
    turned = (BODY.triangles * (2, 3, 4))[..., [1, 0, 2]] * (-1, 1, 1)
    assert_same_surface(read.visuals[0].mesh, 1000.0 * (turned + np.array([0.1, 0, 0])))


@pytest.mark.parametrize("scale", ["-1 1 1", "1 -2 1", "-1 -1 -1", "-1 -1 1", "0.001"])
def test_normals_stay_outward_at_any_scale(tmp_path, write_urdf, scale):
    BODY.export(tmp_path / "body.obj")
    (read,) = load_robot(write_urdf(link(shape(mesh("body.obj", scale), "collision")))).links
    factors = np.array([float(part) for part in scale.split()]) * np.ones(3)
    volume = read.collisions[0].mesh.require_closed("body").signed_volume_mm3
    assert volume == pytest.approx(1e9 * BODY.volume * abs(factors.prod()))


@pytest.mark.parametrize("scale", ["0 1 1", "1 1", "nan 1 1"])
def test_scale_of_zero_or_not_finite_is_refused(tmp_path, write_urdf, scale):
    BODY.export(tmp_path / "body.stl")
    with pytest.raises(RobotMeshError, match=r"scale of mesh 'body.stl'"):
        load_robot(write_urdf(link(shape(mesh("body.stl", scale), "collision"))))


def test_one_file_is_used_at_two_scales(tmp_path, write_urdf):
    BODY.export(tmp_path / "body.stl")
    (read,) = load_robot(
        write_urdf(link(shape(mesh("body.stl")), shape(mesh("body.stl", "0.5 0.5 0.5"))))
    ).links
    big, small = (each.mesh.signed_volume_mm3 for each in read.visuals)
    assert big == pytest.approx(8.0 * small)


def test_missing_mesh_for_display_is_a_warning(write_urdf):
    robot = load_robot(
        write_urdf(link(shape(mesh("package://gone/a.stl")), shape('<sphere radius="1"/>')))
    )
    assert [each.source for each in robot.links[0].visuals] == ["sphere"]
    (warning,) = robot.warnings
    assert "package://gone/a.stl" in warning
    assert "'a'" in warning


def test_missing_mesh_for_collision_is_an_error(write_urdf):
    with pytest.raises(RobotMeshError, match=r"collision mesh 'gone.stl' of link 'a' not found"):
        load_robot(write_urdf(link(shape(mesh("gone.stl"), "collision"))))


@pytest.mark.parametrize("kind", ["visual", "collision"])
@pytest.mark.parametrize("name", ["package://p/../../x.stl", "https://example.org/x.stl"])
def test_unsafe_name_is_an_error_for_display_and_collision(write_urdf, kind, name):
    with pytest.raises(RobotMeshError, match=r"leaves its package|scheme"):
        load_robot(write_urdf(link(shape(mesh(name), kind))))


def test_malformed_mesh_is_a_warning_for_display_and_an_error_for_collision(tmp_path, write_urdf):
    (tmp_path / "broken.stl").write_bytes(b"not a mesh at all" * 10)
    robot = load_robot(write_urdf(link(shape(mesh("broken.stl")))))
    assert robot.links[0].visuals == ()
    assert "broken.stl" in robot.warnings[0]
    assert "\n" not in robot.warnings[0]
    with pytest.raises(RobotMeshError, match=r"broken.stl"):
        load_robot(write_urdf(link(shape(mesh("broken.stl"), "collision"))))


def test_colour_of_the_urdf_overrides_that_of_the_file(tmp_path, write_urdf):
    painted = BODY.copy()
    painted.visual.face_colors = [0, 255, 0, 255]
    painted.export(tmp_path / "green.ply")
    red = '<material name="red"><color rgba="1 0 0 0.5"/></material>'
    robot = load_robot(
        write_urdf(
            red
            + link(
                shape(mesh("green.ply")),
                shape(mesh("green.ply"), extra='<material name="red"/>'),
                shape(mesh("green.ply"), extra='<material name="blue"/>'),
                shape('<sphere radius="1"/>'),
            )
            # A material defined in a visual is known to the whole robot.
            + link(
                shape(
                    '<sphere radius="1"/>',
                    extra='<material name="blue"><color rgba="0 0 1 1"/></material>',
                ),
                name="b",
            )
            + '<joint name="j" type="fixed"><parent link="a"/><child link="b"/></joint>'
        )
    )
    colors = [each.color for each in robot.links[0].visuals]
    assert colors == [(0, 1, 0, 1), (1, 0, 0, 0.5), (0, 0, 1, 1), None]


def test_package_of_a_robot_is_found_beside_it(tmp_path, write_urdf):
    """``package://arm`` in a folder of another name, by the name in its package.xml."""
    folder = tmp_path / "checkout"
    (folder / "meshes").mkdir(parents=True)
    (folder / "package.xml").write_text("<package><name>arm</name></package>")
    trimesh.creation.box(extents=(0.1, 0.2, 0.3)).export(folder / "meshes" / "box.stl")
    urdf = folder / "urdf" / "arm.urdf"
    urdf.parent.mkdir()
    text = write_urdf(link(shape(mesh("package://arm/meshes/box.stl")))).read_text()
    urdf.write_text(text)
    given, found = load_robot(urdf, package_dirs=[folder]), load_robot(urdf)
    for robot in (given, found):
        np.testing.assert_allclose(robot.links[0].visuals[0].mesh.bounds_mm[1], [50, 100, 150])


def test_omni_loads_with_and_without_its_package_folder(shared_data):
    urdf = shared_data / "omni" / "urdf" / "omni.urdf"
    given = load_robot(urdf, package_dirs=[shared_data / "omni"])
    found = load_robot(urdf)
    for one, other in zip(given.links, found.links, strict=True):
        assert one.visuals[0].color == other.visuals[0].color
        np.testing.assert_array_equal(
            one.visuals[0].mesh.vertices_mm, other.visuals[0].mesh.vertices_mm
        )
