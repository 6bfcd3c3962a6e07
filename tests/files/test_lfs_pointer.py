"""A pointer of Git LFS in place of a file is named as such, whatever its format."""

import pytest

from app.files.meshes import load_mesh
from app.geometry import MeshError
from app.robot import RobotMeshError, UrdfError, load_robot

POINTER = """version https://git-lfs.github.com/spec/v1
oid sha256:4d7a214614ab2935c943f9e0ff69d22eadbb8f32b1258daaa5e2ca24d17e2393
size 12345
"""


@pytest.mark.parametrize("ending", [".stl", ".obj", ".ply"])
def test_pointer_in_place_of_a_mesh_is_named(tmp_path, ending):
    path = tmp_path / f"a{ending}"
    path.write_text(POINTER)
    with pytest.raises(MeshError, match="pointer of Git LFS to a file that is not here"):
        load_mesh(path, units="mm", frame="tool")


def test_pointer_in_place_of_a_robot_or_its_mesh_is_named(tmp_path):
    (tmp_path / "a.urdf").write_text(POINTER)
    with pytest.raises(UrdfError, match="pointer of Git LFS"):
        load_robot(tmp_path / "a.urdf")
    for ending in (".dae", ".glb", ".gltf", ".stl"):
        (tmp_path / f"m{ending}").write_text(POINTER)
        (tmp_path / "b.urdf").write_text(
            '<robot name="a"><link name="l"><collision><geometry>'
            f'<mesh filename="m{ending}"/></geometry></collision></link></robot>'
        )
        with pytest.raises(RobotMeshError, match="pointer of Git LFS"):
            load_robot(tmp_path / "b.urdf")
