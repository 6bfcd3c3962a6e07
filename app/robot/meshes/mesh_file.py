"""Mesh files of robots: STL, OBJ, DAE, GLB, glTF and PLY."""

from pathlib import Path

from app.files.mesh_file import FileMesh, MeshOptions, read_mesh_file
from app.robot.errors import RobotMeshError

OPTIONS = MeshOptions(
    formats=(".stl", ".obj", ".dae", ".glb", ".gltf", ".ply"),
    max_bytes=80 * 1024 * 1024,
    max_triangles=2_500_000,
    linked_files=True,
    error=RobotMeshError,
)


def read_robot_mesh(path: Path) -> FileMesh:
    """Read a mesh file of a robot, in the file's unit (m for COLLADA).

    Raises `RobotMeshError` as `read_mesh_file` describes.
    """
    return read_mesh_file(path, OPTIONS)
