"""Mesh files whose headers and graphs promise more than they hold are refused at once."""

import base64
import json
import math

import numpy as np
import pytest
import trimesh

from app.files import load_mesh
from app.files.mesh_file import read_mesh_file
from app.geometry import MeshError
from app.robot import RobotMeshError
from app.robot.mesh_locator import OPTIONS, read_robot_mesh

TRIANGLE = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]], dtype="<f4")


def gltf(tmp_path, nodes, *, scene=(0,), primitive=None, indices=(0, 1, 2), **accessor):
    """Write a glTF of one mesh of four vertices; ``accessor`` changes its positions."""
    corners = np.array(indices, dtype="<u4").tobytes()
    data = TRIANGLE.tobytes() + corners
    document = {
        "asset": {"version": "2.0"},
        "scenes": [{"nodes": list(scene)}],
        "nodes": nodes,
        "meshes": [
            {"primitives": [{"attributes": {"POSITION": 0}, "indices": 1, **(primitive or {})}]}
        ],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3", **accessor},
            {"bufferView": 1, "componentType": 5125, "count": len(indices), "type": "SCALAR"},
        ],
        "bufferViews": [
            {"buffer": 0, "byteLength": 48},
            {"buffer": 0, "byteOffset": 48, "byteLength": len(corners)},
        ],
        "buffers": [
            {
                "byteLength": len(data),
                "uri": "data:application/octet-stream;base64," + base64.b64encode(data).decode(),
            }
        ],
    }
    path = tmp_path / "a.gltf"
    path.write_text(json.dumps(document))
    return path


def refusal(path):
    with pytest.raises(RobotMeshError) as caught:
        read_robot_mesh(path)
    return str(caught.value)


def test_chain_of_100_000_nodes_is_refused(tmp_path):
    nodes = [{"children": [n + 1]} for n in range(99_998)] + [{"mesh": 0}]
    assert "more than 50000 values" in refusal(gltf(tmp_path, nodes))
    nodes = [{"children": [n + 1]} for n in range(100)] + [{"mesh": 0}]
    assert "nested deeper than 100 levels" in refusal(gltf(tmp_path, nodes))


@pytest.mark.parametrize(
    "nodes", [[{"children": [0]}], [{"children": [1, 2]}, {"children": [2]}, {"mesh": 0}]]
)
def test_nodes_that_are_no_tree_are_refused(tmp_path, nodes):
    assert "expected a tree" in refusal(gltf(tmp_path, nodes))


SPARSE = {
    "count": 1,
    "indices": {"bufferView": 1, "componentType": 5125},
    "values": {"bufferView": 0},
}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"count": 10**9}, "outside of its buffer"),
        ({"count": -1}, "'$.accessors[0].count': -1 is less than the minimum of 1"),
        ({"byteOffset": 8}, "outside of its buffer"),
        ({"sparse": SPARSE}, "sparse or without data"),
        ({"type": "VEC2"}, "expected VEC3"),
        ({"bufferView": 7}, "expected 0 to 1"),
        ({"bufferView": -1}, "-1 is less than the minimum of 0"),
        ({"normalized": True}, "positions of meshes[0].primitives[0] that are normalized"),
    ],
)
def test_accessor_outside_of_its_buffer_is_refused(tmp_path, change, message):
    assert message in refusal(gltf(tmp_path, [{"mesh": 0}], **change))


def test_indices_of_another_part_are_refused(tmp_path):
    nodes = [{"mesh": 0}, {"mesh": 0}]
    path = gltf(tmp_path, nodes, scene=(0, 1), indices=(0, 1, 5))
    assert "faces of vertices that it does not hold" in refusal(path)


def test_instances_beyond_the_limit_are_refused(tmp_path):
    """Places of triangles, and a part of one triangle that shares many vertices."""
    for indices, message in (((0, 1, 2) * 2, "more than 19 tri"), ((0, 1, 2), "60 vertices")):
        path = gltf(tmp_path, [{"mesh": 0}] * 20, scene=range(20), indices=indices)
        options = type(OPTIONS)(formats=(".gltf",), max_bytes=1000, max_triangles=19)
        with pytest.raises(MeshError, match=message):
            read_mesh_file(path, options)


@pytest.mark.parametrize(
    ("node", "primitive", "message"),
    [
        ({}, {"mode": 6}, "the mode 6 in meshes[0].primitives[0]"),
        ({"translation": [math.nan, 0, 0]}, {}, "transform of a node that is not finite"),
        ({"rotation": [0, 0, 0, 0]}, {}, "a rotation of length 0"),
        ({}, {"material": 0}, "names materials[0]"),
    ],
)
def test_what_trimesh_leaves_out_is_refused(tmp_path, node, primitive, message):
    path = gltf(tmp_path, [{**node, "children": [1]}, {"mesh": 0}], primitive=primitive)
    assert message in refusal(path)


def test_parts_at_and_below_a_camera_are_read(tmp_path):
    path = gltf(tmp_path, [{"mesh": 0, "camera": 0, "children": [1]}, {"mesh": 0}])
    assert len(read_robot_mesh(path).faces) == 2


def test_rotation_of_single_precision_is_read(tmp_path):
    assert len(
        read_robot_mesh(gltf(tmp_path, [{"mesh": 0, "rotation": [0, 0, 0, 1.0000001]}])).faces
    )
    path = gltf(tmp_path, [{"mesh": 0, "rotation": [0, 0, 0, 1.001]}])
    assert "1.001 is greater than the maximum of 1" in refusal(path)


def test_parts_are_in_the_order_of_the_file(tmp_path):
    path = gltf(tmp_path, [{"mesh": 0}])
    document = json.loads(path.read_text())
    mesh, colors = document["meshes"][0], [[0, 0, n / 255, 1] for n in range(8)]
    mesh["primitives"] = [{**mesh["primitives"][0], "material": n} for n in range(8)]
    document["materials"] = [{"pbrMetallicRoughness": {"baseColorFactor": c}} for c in colors]
    path.write_text(json.dumps(document))
    np.testing.assert_allclose(read_robot_mesh(path).face_colors, colors)


@pytest.mark.parametrize("mode", [4, 5])
def test_lists_and_strips_agree_with_trimesh(tmp_path, mode):
    indices = (0, 1, 2, 1, 3, 2) if mode == 4 else (0, 1, 2, 3)
    node = {"mesh": 0, "translation": [1, 2, 3], "rotation": [0, 0, 0.6, 0.8], "scale": [1, 2, 3]}
    path = gltf(tmp_path, [node], primitive={"mode": mode}, indices=indices)
    ours, theirs = read_robot_mesh(path), trimesh.load_scene(path).to_mesh()
    triangles = ours.vertices[ours.faces]
    np.testing.assert_allclose(triangles.mean(axis=1), theirs.triangles_center, atol=1e-6)
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    np.testing.assert_allclose(normals / 2.0, theirs.face_normals * theirs.area_faces[:, None])


STL = """solid a
facet normal 0 0 {z}
outer loop
vertex 0 0 0
vertex 1 0 {x}
vertex 0 1 0
endloop
endfacet
endsolid a
"""


def test_normal_that_is_no_number_is_ignored_without_a_line(tmp_path, capfd):
    (tmp_path / "a.stl").write_text(STL.format(z="x", x="0"))
    assert len(load_mesh(tmp_path / "a.stl", units="mm", frame="tumor").faces) == 1
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (STL.format(z="1", x="y"), "cannot be read"),
        ("no mesh " * 20, "is not an STL: it has 160 bytes; expected .* begins with 'solid'"),
        (STL.format(z="1", x="0") + STL.format(z="1", x="0")[:60], "does not end with 'endsolid'"),
        ("solid a\nendsolid a\n" * 1001, "1001 solids; expected at most 1000"),
    ],
)
def test_text_that_is_no_whole_stl_is_refused(tmp_path, text, message):
    (tmp_path / "a.stl").write_text(text)
    with pytest.raises(MeshError, match=message):
        load_mesh(tmp_path / "a.stl", units="mm", frame="tumor")


def test_header_that_declares_more_than_the_file_holds_is_refused(tmp_path):
    header = "ply\nformat binary_little_endian 1.0\nelement vertex 1000000000000\nend_header\n"
    (tmp_path / "a.ply").write_text(header)
    with pytest.raises(MeshError, match="declares 1000000000000 elements 'vertex'"):
        load_mesh(tmp_path / "a.ply", units="mm", frame="tumor")


def test_obj_of_too_many_materials_is_refused(tmp_path):
    lines = [f"usemtl m{n}\nf 1 2 3" for n in range(1001)]
    (tmp_path / "a.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\n" + "\n".join(lines))
    assert "1001 materials; expected at most 1000" in refusal(tmp_path / "a.obj")


def test_obj_reads_no_file_outside_its_folder(tmp_path):
    (tmp_path / "red.mtl").write_text("newmtl red\nKd 1 0 0\n")
    (tmp_path / "in").mkdir()
    text = "mtllib ../red.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl red\nf 1 2 3\n"
    (tmp_path / "in" / "a.obj").write_text(text)
    assert read_robot_mesh(tmp_path / "in" / "a.obj").face_colors is None
