from .atomic_io import check_output_path, write_file
from .document_text import schema_text
from .landmarks import POINT_ENDINGS, read_landmarks
from .meshes import MESH_ENDINGS, UNITS_MM, check_mesh_path, load_mesh, write_mesh
from .plus_config import PlusConfiguration, read_plus_config
from .transforms import (
    TRANSFORM_ENDINGS,
    check_transform_path,
    read_transform,
    write_transform,
)

__all__ = [
    "MESH_ENDINGS",
    "POINT_ENDINGS",
    "TRANSFORM_ENDINGS",
    "UNITS_MM",
    "PlusConfiguration",
    "check_mesh_path",
    "check_output_path",
    "check_transform_path",
    "load_mesh",
    "read_landmarks",
    "read_plus_config",
    "read_transform",
    "schema_text",
    "write_file",
    "write_mesh",
    "write_transform",
]
