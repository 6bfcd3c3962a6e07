"""Mesh files of cases and robots: STL, PLY, OBJ, COLLADA, GLB and glTF."""

import base64
import json
from collections.abc import Sequence
from functools import cache
from pathlib import Path

import trimesh
from trimesh.transformations import translation_matrix

from app.files import load_mesh
from app.robot.meshes.mesh_file import read_robot_mesh
from benchmarks.fuzz.mutators.gltf import GLB, GLTF
from benchmarks.fuzz.mutators.raw import RAW
from benchmarks.fuzz.mutators.text import TEXT
from benchmarks.fuzz.mutators.tree import mutate_xml
from benchmarks.fuzz.parser import FuzzedParser

_MTL = b"newmtl red\nKd 1 0 0\nnewmtl blue\nKd 0 0 1\nd 0.5\nmap_Kd picture.png\n"
_DAE = """<?xml version="1.0"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><unit name="millimeter" meter="0.001"/><up_axis>Z_UP</up_axis></asset>
<library_effects><effect id="e"><profile_COMMON><technique sid="t"><phong><diffuse>
<color>1 0 0 1</color></diffuse></phong></technique></profile_COMMON></effect></library_effects>
<library_materials><material id="m"><instance_effect url="#e"/></material></library_materials>
<library_geometries><geometry id="g"><mesh>
<source id="p"><float_array id="pa" count="12">0 0 0 1 0 0 0 1 0 0 0 1</float_array>
<technique_common><accessor source="#pa" count="4" stride="3"><param name="X" type="float"/>
<param name="Y" type="float"/><param name="Z" type="float"/></accessor></technique_common></source>
<source id="n"><float_array id="na" count="6">0 0 1 0 0 -1</float_array><technique_common>
<accessor source="#na" count="2" stride="3"><param name="X" type="float"/>
<param name="Y" type="float"/><param name="Z" type="float"/></accessor></technique_common></source>
<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
<triangles count="2" material="m"><input semantic="VERTEX" source="#v" offset="0"/>
<input semantic="NORMAL" source="#n" offset="1"/><p>0 0 2 0 1 0 0 1 1 1 3 1</p></triangles>
<polylist count="2" material="m"><input semantic="VERTEX" source="#v" offset="0"/>
<vcount>3 4</vcount><p>1 2 3 0 3 2 1</p></polylist>
</mesh></geometry></library_geometries>
<library_nodes><node id="part"><instance_geometry url="#g"/></node></library_nodes>
<library_visual_scenes><visual_scene id="s"><node id="a"><matrix>1 0 0 5 0 1 0 0 0 0 1 0 0 0 0 1
</matrix><rotate>0 0 1 90</rotate><instance_geometry url="#g"><bind_material><technique_common>
<instance_material symbol="m" target="#m"/></technique_common></bind_material></instance_geometry>
<node id="b"><scale>1 1 -2</scale><translate>1 2 3</translate><instance_node url="#part"/></node>
</node></visual_scene></library_visual_scenes>
<scene><instance_visual_scene url="#s"/></scene></COLLADA>
"""


@cache
def _box() -> trimesh.Trimesh:
    return trimesh.creation.box((1.0, 2.0, 3.0))


def _stl_seeds() -> Sequence[bytes]:
    text = trimesh.exchange.stl.export_stl_ascii(_box()).encode()
    binary = trimesh.exchange.stl.export_stl(_box())
    named = b"solid Slicer SPACE=LPS" + text[text.index(b"\n") :]
    return [binary, b"MarginGuard SPACE=RAS".ljust(80) + binary[80:], text, named, text + text]


def _ply_seeds() -> Sequence[bytes]:
    plain, coloured = _box(), _box().copy()
    coloured.visual.vertex_colors = [[200, 10, 10, 255]] * len(coloured.vertices)
    export = trimesh.exchange.ply.export_ply
    return [
        export(plain),
        export(coloured),
        export(plain, encoding="ascii"),
        export(coloured, encoding="ascii"),
        export(plain).replace(b"format", b"comment SPACE=LPS\nformat", 1),
    ]


def _obj_seeds() -> Sequence[bytes]:
    text = trimesh.exchange.obj.export_obj(_box()).encode()
    faces = b"\n".join(b"f " + line[2:] for line in text.split(b"\n") if line.startswith(b"f "))
    with_materials = b"mtllib two.mtl\nusemtl red\n" + text + b"\nusemtl blue\n" + faces
    points = b"v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvn 0 0 1\n"
    quads = points + b"f 1/1/1 2/1/1 3/1/1 4/1/1\nf -1 -2 -3\n"
    return [text, b"# SPACE=LPS\n" + text, with_materials, quads]


def _scene() -> trimesh.Scene:
    scene = trimesh.Scene()
    red = _box().copy()
    red.visual = trimesh.visual.TextureVisuals(
        material=trimesh.visual.material.PBRMaterial(baseColorFactor=[255, 0, 0, 255])
    )
    scene.add_geometry(red, node_name="red", geom_name="box")
    scene.graph.update("moved", "red", matrix=translation_matrix((0, 4, 0)), geometry="box")
    return scene


def _glb_seeds() -> Sequence[bytes]:
    return [_box().export(file_type="glb"), _scene().export(file_type="glb")]


def _gltf_seeds() -> Sequence[bytes]:
    documents = []
    for scene in (_scene(), trimesh.Scene(_box())):
        files = trimesh.exchange.gltf.export_gltf(scene, merge_buffers=True)
        document = json.loads(files["model.gltf"])
        for buffer in document["buffers"]:
            content = base64.b64encode(files[buffer["uri"]]).decode()
            buffer["uri"] = f"data:application/octet-stream;base64,{content}"
        documents.append(document)
    linked = json.loads(json.dumps(documents[1]))
    for buffer in linked["buffers"]:
        buffer["uri"] = "buffer.bin"
    return [json.dumps(each).encode() for each in (*documents, linked)]


def _buffer() -> bytes:
    """Content of the buffers of a box."""
    files = trimesh.exchange.gltf.export_gltf(trimesh.Scene(_box()), merge_buffers=True)
    return next(content for name, content in files.items() if name.endswith(".bin"))


def _load_case_mesh(path: Path) -> object:
    return load_mesh(path, units="mm", frame="tumor")


PARSERS = (
    FuzzedParser("stl", "mesh.stl", _load_case_mesh, _stl_seeds, (*TEXT, *RAW)),
    FuzzedParser("ply", "mesh.ply", _load_case_mesh, _ply_seeds, (*TEXT, *RAW)),
    FuzzedParser(
        "obj", "mesh.obj", read_robot_mesh, _obj_seeds, TEXT, {"two.mtl": _MTL, "picture.png": b"x"}
    ),
    FuzzedParser(
        "dae",
        "mesh.dae",
        read_robot_mesh,
        lambda: [_DAE.encode()],
        (*TEXT, *[mutate_xml] * 2 * len(TEXT)),
    ),
    FuzzedParser("glb", "mesh.glb", read_robot_mesh, _glb_seeds, (*RAW, *GLB)),
    FuzzedParser(
        "gltf", "mesh.gltf", read_robot_mesh, _gltf_seeds, GLTF, {"buffer.bin": _buffer()}
    ),
)
