"""Primitives and mesh files of robots: several parts, node transforms, units, malformed files."""

import math
import re
from dataclasses import replace

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from trimesh.transformations import translation_matrix

from app.geometry import SurfaceMesh
from app.robot import RobotMeshError, primitives
from app.robot.mesh_locator import OPTIONS, read_robot_mesh


def box(size=(1.0, 1.0, 1.0), color=None):
    made = trimesh.creation.box(size)
    if color is not None:
        material = trimesh.visual.material.PBRMaterial(baseColorFactor=color)
        made.visual = trimesh.visual.TextureVisuals(material=material)
    return made


def surface(path):
    read = read_robot_mesh(path)
    return SurfaceMesh("file", read.vertices, read.faces), read.face_colors


def test_scene_of_parts_is_one_surface_with_the_colour_of_each(tmp_path):
    scene = trimesh.Scene()
    scene.add_geometry(box(color=[255, 0, 0, 255]), node_name="red")
    nested = translation_matrix((5, 0, 0)) @ np.diag((2.0, 1.0, 1.0, 1.0))
    scene.add_geometry(box(color=[0, 0, 255, 255]), node_name="blue", transform=nested)
    scene.export(tmp_path / "two.glb")
    mesh, colors = surface(tmp_path / "two.glb")
    mesh.require_closed("two boxes")
    np.testing.assert_allclose(mesh.bounds_mm, [(-0.5, -0.5, -0.5), (6.0, 0.5, 0.5)])
    middle = mesh.triangles_mm.mean(axis=1)[:, 0]
    np.testing.assert_allclose(colors[middle < 2], [(1, 0, 0, 1)] * 12)
    np.testing.assert_allclose(colors[middle > 2], [(0, 0, 1, 1)] * 12)


def test_part_is_repeated_at_each_of_its_places(tmp_path):
    scene = trimesh.Scene()
    scene.add_geometry(box(), geom_name="box", node_name="here")
    scene.graph.update("there", matrix=translation_matrix((0, 4, 0)), geometry="box")
    scene.export(tmp_path / "twice.glb")
    mesh, _ = surface(tmp_path / "twice.glb")
    assert mesh.signed_volume_mm3 == pytest.approx(2.0)
    np.testing.assert_allclose(mesh.bounds_mm[1], [0.5, 4.5, 0.5])


def test_mirrored_node_keeps_its_normals_outward(tmp_path):
    scene = trimesh.Scene()
    scene.add_geometry(box((1, 2, 3)), transform=np.diag((-1.0, 1.0, 1.0, 1.0)))
    scene.export(tmp_path / "mirrored.glb")
    mesh, _ = surface(tmp_path / "mirrored.glb")
    assert mesh.require_closed("mirrored").signed_volume_mm3 == pytest.approx(6.0)


def test_obj_of_several_materials_has_their_colours(tmp_path):
    (tmp_path / "two.mtl").write_text("newmtl red\nKd 1 0 0\nnewmtl blue\nKd 0 0 1\n")
    red, blue = box(), box()
    blue.apply_translation((3, 0, 0))
    lines, offset = ["mtllib two.mtl"], 1
    for name, part in (("red", red), ("blue", blue)):
        lines += [f"v {x} {y} {z}" for x, y, z in part.vertices]
        lines += [f"usemtl {name}"]
        lines += ["f " + " ".join(str(i + offset) for i in face) for face in part.faces]
        offset += len(part.vertices)
    (tmp_path / "two.obj").write_text("\n".join(lines))
    mesh, colors = surface(tmp_path / "two.obj")
    assert mesh.require_closed("two").signed_volume_mm3 == pytest.approx(2.0)
    left = mesh.triangles_mm.mean(axis=1)[:, 0] < 1.5
    np.testing.assert_allclose(colors[left], [(1, 0, 0, 1)] * 12)
    np.testing.assert_allclose(colors[~left], [(0, 0, 1, 1)] * 12)


@pytest.fixture
def dae(tmp_path):
    """Return a function that writes a box of 1 x 2 x 3 units as COLLADA with changes."""

    def write(*changes, name="box.dae"):
        box((1, 2, 3), color=[255, 0, 0, 255]).export(tmp_path / name)
        text = (tmp_path / name).read_text()
        for pattern, replacement in changes:
            text, count = re.subn(pattern, replacement, text, count=1)
            assert count == 1, pattern
        (tmp_path / name).write_text(text)
        return tmp_path / name

    return write


UNIT = r"(?=<up_axis>)"  # trimesh writes no unit: insert it here


@pytest.mark.parametrize(
    ("unit", "metres"), [('<unit name="mm" meter="0.001"/>', 0.001), ('<unit name="x"/>', 1.0)]
)
def test_unit_of_a_collada_file_is_applied(dae, unit, metres):
    mesh, _ = surface(dae((UNIT, unit)))
    np.testing.assert_allclose(mesh.bounds_mm[1], np.array([0.5, 1.0, 1.5]) * metres)


@pytest.mark.parametrize("up", ["X_UP", "Y_UP", "Z_UP"])
def test_up_axis_of_a_collada_file_is_not_applied(dae, up):
    mesh, _ = surface(dae((r"<up_axis>[^<]*</up_axis>", f"<up_axis>{up}</up_axis>")))
    np.testing.assert_allclose(mesh.bounds_mm[1], [0.5, 1.0, 1.5])


def test_node_transforms_of_a_collada_file_are_applied(dae):
    node = r"(<node [^>]*>)"
    moved = r"\1<translate>0 0 10</translate><rotate>0 0 1 90</rotate><scale>2 1 1</scale>"
    mesh, colors = surface(dae((node, moved)))
    # scaled along x, rotated to y, translated along z
    np.testing.assert_allclose(mesh.bounds_mm, [(-1, -1, 8.5), (1, 1, 11.5)], atol=1e-9)
    assert mesh.signed_volume_mm3 == pytest.approx(12.0)
    np.testing.assert_allclose(colors, [(1, 0, 0, 1)] * 12)


def test_part_with_a_missing_material_keeps_its_geometry(dae):
    whole, _ = surface(dae())
    broken, colors = surface(dae((r'(<instance_effect url=")#[^"]*"', r'\1#gone"')))
    assert colors is None
    np.testing.assert_array_equal(broken.triangles_mm, whole.triangles_mm)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ((UNIT, '<unit meter="zero"/>'), "unit 'zero'"),
        ((UNIT, '<unit meter="0"/>'), "unit '0'"),
        ((r"<instance_geometry url=\"[^\"]*\"", '<instance_geometry url="#gone"'), "cannot be"),
        ((r'(id="verts-array-array">)', r"\1 abc "), "'abc'"),
        ((r"(<node [^>]*>)", r'\1<instance_controller url="#skin"/>'), "skinned"),
        ((r"<COLLADA", "<!DOCTYPE x><COLLADA"), "DOCTYPE"),
    ],
)
def test_collada_that_cannot_be_read_completely_is_refused(dae, change, message):
    with pytest.raises(RobotMeshError, match=message) as caught:
        read_robot_mesh(dae(change))
    assert "\n" not in str(caught.value)


def doubled(times):
    """Changes that place the box 2^times times: each level has two instances of the next."""
    levels = "".join(
        f'<node id="n{n}"><instance_node url="#n{n - 1}"/><instance_node url="#n{n - 1}"/></node>'
        for n in range(1, times + 1)
    )
    return (
        r"(?s)(<library_visual_scenes>.*<visual_scene[^>]*>).*(<node.*?</node>)\s*</visual_scene>",
        rf'<library_nodes><node id="n0">\2</node>{levels}</library_nodes>\1'
        rf'<node id="top"><instance_node url="#n{times}"/></node></visual_scene>',
    )


def test_nested_instances_are_bounded(dae):
    assert len(read_robot_mesh(dae(doubled(4))).faces) == 12 * 2**4
    with pytest.raises(RobotMeshError, match=r"has \d{15,} bytes with its instances"):
        read_robot_mesh(dae(doubled(40)))
    loop = ('<instance_node url="#n0"/>', '<instance_node url="#n1"/>')
    with pytest.raises(RobotMeshError, match="a node 'n1' that contains itself"):
        read_robot_mesh(dae(doubled(1), loop))


def test_triangles_are_counted_at_all_places(tmp_path, monkeypatch):
    scene = trimesh.Scene()
    for place in range(5):
        scene.add_geometry(box(), transform=translation_matrix((place, 0, 0)), geom_name="one")
    scene.export(tmp_path / "five.glb")
    options = "app.robot.mesh_locator.OPTIONS"
    monkeypatch.setattr(options, replace(OPTIONS, max_triangles=60))
    assert len(read_robot_mesh(tmp_path / "five.glb").faces) == 60
    monkeypatch.setattr(options, replace(OPTIONS, max_triangles=59))
    with pytest.raises(RobotMeshError, match=r"five\.glb has more than 59 triangles"):
        read_robot_mesh(tmp_path / "five.glb")


@pytest.mark.parametrize("suffix", ["stl", "obj", "ply", "dae"])
def test_vertices_that_are_not_finite_are_refused(tmp_path, suffix):
    holed = box()
    holed.export(tmp_path / f"good.{suffix}")
    vertices = holed.vertices.copy()
    vertices[3] = np.nan
    bad = trimesh.Trimesh(vertices, holed.faces, process=False)
    bad.export(tmp_path / f"bad.{suffix}")
    assert len(read_robot_mesh(tmp_path / f"good.{suffix}").faces) == 12
    with pytest.raises(RobotMeshError, match="not finite"):
        read_robot_mesh(tmp_path / f"bad.{suffix}")


@pytest.mark.parametrize("suffix", ["stl", "obj", "dae", "glb", "ply"])
@pytest.mark.parametrize("content", [b"", b"\x00" * 50, b"hello\n" * 20])
def test_file_of_other_content_is_refused_in_one_line(tmp_path, suffix, content):
    path = tmp_path / f"garbage.{suffix}"
    path.write_bytes(content)
    with pytest.raises(RobotMeshError, match="garbage") as caught:
        read_robot_mesh(path)
    assert "\n" not in str(caught.value)


def test_picture_of_a_ply_is_not_opened(tmp_path, caplog):
    """trimesh would log an invalid picture with a traceback."""
    (tmp_path / "picture.png").write_bytes(b"none")
    text = box().export(file_type="ply", encoding="ascii").decode()
    named = text.replace("element vertex", "comment TextureFile picture.png\nelement vertex", 1)
    (tmp_path / "box.ply").write_text(named)
    assert len(read_robot_mesh(tmp_path / "box.ply").faces) == 12
    assert "image" not in caplog.text


def test_truncated_other_or_empty_files_are_refused(tmp_path):
    (tmp_path / "cut.stl").write_bytes(box().export(file_type="stl")[:-70])
    (tmp_path / "model.step").write_text("x")
    trimesh.PointCloud(np.eye(3)).export(tmp_path / "points.ply")
    for name, message in (
        ("cut.stl", "cut.stl"),
        ("model.step", "model.step is of an unknown format; expected .stl, .obj"),
        ("points.ply", "no triangles"),
    ):
        with pytest.raises(RobotMeshError, match=message):
            read_robot_mesh(tmp_path / name)


sizes = st.floats(1e-3, 1e3)


def closed(shape):
    return SurfaceMesh("link", *shape).require_closed("shape")


@settings(max_examples=20)
@given(sizes, sizes, sizes)
def test_box_has_the_given_size(x, y, z):
    mesh = closed(primitives.box((x, y, z)))
    low, high = mesh.bounds_mm
    np.testing.assert_allclose(high, [x / 2, y / 2, z / 2])
    np.testing.assert_allclose(low, -high)
    assert mesh.signed_volume_mm3 == pytest.approx(x * y * z)


@settings(max_examples=20)
@given(sizes, sizes)
def test_cylinder_is_along_z(radius, length):
    mesh = closed(primitives.cylinder(radius, length))
    low, high = mesh.bounds_mm
    np.testing.assert_allclose(high, [radius, radius, length / 2])
    np.testing.assert_allclose(low, -high)
    assert mesh.signed_volume_mm3 == pytest.approx(math.pi * radius**2 * length, rel=0.003)


@settings(max_examples=20)
@given(sizes)
def test_sphere_has_the_given_radius(radius):
    mesh = closed(primitives.sphere(radius))
    np.testing.assert_allclose(np.linalg.norm(mesh.vertices_mm, axis=1), radius)
    assert mesh.signed_volume_mm3 == pytest.approx(4 / 3 * math.pi * radius**3, rel=0.01)


@pytest.mark.parametrize("bad", [0.0, -1.0, math.nan, math.inf])
def test_size_that_is_not_above_zero_is_refused(bad):
    for make, size in (
        (primitives.box, ((1.0, bad, 1.0),)),
        (primitives.cylinder, (1.0, bad)),
        (primitives.sphere, (bad,)),
    ):
        with pytest.raises(RobotMeshError, match="above 0"):
            make(*size)
