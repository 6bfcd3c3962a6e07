"""A pipe, a device or a name that is too long in the place of a file is refused at once."""

import os
from pathlib import Path

import pytest

from app.geometry import MarginGuardError
from app.robot import RobotMeshError, UrdfError, load_robot
from app.robot.mesh_locator import read_robot_mesh
from tests.fuzz.parsers import PARSERS

pytestmark = pytest.mark.slow

EACH_FILE = pytest.mark.parametrize(
    "parser", [pytest.param(each, id=name) for name, each in PARSERS.items() if each.names_file]
)


@EACH_FILE
def test_pipe_in_the_place_of_a_file_is_refused(parser, tmp_path):
    os.mkfifo(tmp_path / parser.file_name)
    with pytest.raises(MarginGuardError) as caught:
        parser.parse(tmp_path / parser.file_name)
    assert "\n" not in str(caught.value)


@EACH_FILE
def test_folder_and_name_of_no_file_are_refused(parser, tmp_path):
    ending = parser.file_name.partition(".")[2]
    (tmp_path / parser.file_name).mkdir()
    for path in (tmp_path / parser.file_name, tmp_path / f"{'a' * 100_000}.{ending}"):
        with pytest.raises(MarginGuardError) as caught:
            parser.parse(path)
        assert "\n" not in str(caught.value)
        assert len(str(caught.value)) < 2000


def test_pipe_as_a_linked_file_is_refused(tmp_path):
    for name in ("a.mtl", "a.bin", "a.stl", "part.xacro"):
        os.mkfifo(tmp_path / name)
    obj = "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl red\nf 1 2 3\n"
    (tmp_path / "a.obj").write_text(obj)
    assert read_robot_mesh(tmp_path / "a.obj").face_colors is None
    (tmp_path / "a.gltf").write_text(GLTF)
    with pytest.raises(RobotMeshError, match="a buffer 0 that cannot be read"):
        read_robot_mesh(tmp_path / "a.gltf")
    head = '<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro">'
    (tmp_path / "r.xacro").write_text(f'{head}<xacro:include filename="part.xacro"/></robot>')
    with pytest.raises(UrdfError, match="No such file"):
        load_robot(Path(tmp_path / "r.xacro"))


GLTF = """{"asset": {"version": "2.0"}, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
"meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
"accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"}],
"bufferViews": [{"buffer": 0, "byteLength": 36}],
"buffers": [{"byteLength": 36, "uri": "a.bin"}]}"""
