"""Descriptions of robots and of simulated worlds: URDF, xacro, ADF, maps of meshes, world.yaml."""

import re
from collections.abc import Sequence
from pathlib import Path

from app.files.shipped import shipped
from app.robot import load_robot, robot_from_text
from app.robot.description.ambf import bodies_from_mesh_map
from app.robot.description.xacro_file import expand_xacro
from app.simulation import open_world
from benchmarks.fuzz.forked import start_forked
from benchmarks.fuzz.mutators.text import TEXT
from benchmarks.fuzz.mutators.tree import mutate_xml
from benchmarks.fuzz.mutators.xacro_text import XACRO
from benchmarks.fuzz.mutators.yaml_text import YAML
from benchmarks.fuzz.parser import FuzzedParser

_ONE = b"\0\0\x80\x3f"
_STL = bytes(80) + b"\1\0\0\0" + bytes(24) + _ONE + bytes(12) + _ONE + bytes(6)
_URDF = """<?xml version="1.0"?>
<robot name="arm">
<material name="grey"><color rgba="0.5 0.5 0.5 1"/></material>
<link name="base"><visual><origin xyz="0 0 0.1" rpy="0 0 1.57"/><geometry>
<box size="0.1 0.2 0.3"/></geometry><material name="grey"/></visual>
<collision><geometry><cylinder radius="0.1" length="0.2"/></geometry></collision>
<inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/>
</inertial></link>
<link name="upper"><visual><geometry><mesh filename="part.stl" scale="1 1 -1"/></geometry></visual>
<collision><geometry><sphere radius="0.1"/></geometry></collision></link>
<link name="tip"/><link name="finger"/>
<joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/>
<origin xyz="0 0 0.3" rpy="0 0.5 0"/><axis xyz="0 0 1"/>
<limit lower="-1.5" upper="1.5" effort="1" velocity="1"/></joint>
<joint name="slide" type="prismatic"><parent link="upper"/><child link="tip"/><axis xyz="1 0 0"/>
<limit lower="0" upper="0.1" effort="1" velocity="1"/><dynamics damping="0.1"/></joint>
<joint name="grip" type="continuous"><parent link="tip"/><child link="finger"/>
<axis xyz="0 1 0"/><mimic joint="shoulder" multiplier="2" offset="0.1"/></joint>
</robot>
"""
_XACRO = """<?xml version="1.0"?>
<robot name="arm" xmlns:xacro="http://www.ros.org/wiki/xacro">
<xacro:arg name="length" default="0.5"/><xacro:property name="count" value="${1 + 2}"/>
<xacro:property name="sizes" value="${[0.1, 0.2, 0.3]}"/>
<xacro:property name="limits" value="${xacro.load_yaml('limits.yaml')}"/>
<xacro:include filename="part.xacro"/>
<xacro:macro name="chain" params="n parent:=base *content"><xacro:if value="${n > 0}">
<link name="l${n}"/><joint name="j${n}" type="revolute">
<parent link="${parent}"/><child link="l${n}"/>
<origin xyz="0 0 ${2 * $(arg length)}"/><axis xyz="0 0 1"/>
<limit lower="${-radians(limits['max'])}" upper="${limits['max'] * pi / 180}"/>
<xacro:insert_block name="content"/></joint>
<xacro:chain n="${n - 1}" parent="l${n}"><dynamics damping="${sizes[n - 1]}"/></xacro:chain>
</xacro:if></xacro:macro>
<link name="base"/><xacro:chain n="${count}"><dynamics damping="0"/></xacro:chain>
<xacro:unless value="0">
<xacro:part n="x" size="${' '.join([str(s) for s in sizes])}"/></xacro:unless>
</robot>
"""
_PART = b"""<robot xmlns:xacro="http://www.ros.org/wiki/xacro">
<xacro:macro name="part" params="n size"><link name="p${n}"><visual><geometry>
<box size="${size}"/></geometry></visual></link>
<joint name="k${n}" type="fixed"><parent link="base"/><child link="p${n}"/></joint>
</xacro:macro></robot>
"""
_ADF = """bodies: [BODY base, BODY left arm]
joints: [JOINT a]
high resolution path: ./
low resolution path: ./
BODY base:
  name: base
  mesh: part.stl
  scale: 1.0
  location: {position: {x: 0.0, y: 0.0, z: 0.1}, orientation: {r: 0.0, p: 0.0, y: 0.5}}
  color rgba: {r: 1.0, g: 0.5, b: 0.0, a: 1.0}
BODY left arm:
  name: left arm
  mesh: ''
  shape: Cylinder
  geometry: {radius: 0.1, height: 0.2, axis: z}
  collision shape: Box
  collision geometry: {x: 0.1, y: 0.2, z: 0.3}
  location: {position: {x: 0.0, y: 0.0, z: 0.3}, orientation: {r: 0.0, p: 0.0, y: 0.0}}
JOINT a:
  name: a
  parent: BODY base
  child: BODY left arm
  type: revolute
  parent axis: {x: 0.0, y: 0.0, z: 1.0}
  parent pivot: {x: 0.0, y: 0.0, z: 0.2}
  child axis: {x: 0.0, y: 0.0, z: 1.0}
  child pivot: {x: 0.0, y: 0.0, z: 0.0}
  joint limits: {low: -1.5, high: 1.5}
"""


def _urdf_seeds() -> Sequence[bytes]:
    touch = shipped("data", "robots", "touch", "touch.urdf").read_text()
    for name in set(re.findall('filename="([^"]*)"', touch)):
        touch = touch.replace(f'"{name}"', '"part.stl"')
    return [_URDF.encode(), touch.encode()]


def _adf_seeds() -> Sequence[bytes]:
    loops = shipped("data", "robots", "parallelogram", "parallelogram.yaml")
    return [_ADF.encode(), loops.read_bytes()]


def _read_received_urdf(path: Path) -> None:
    robot_from_text(path.read_bytes().decode("utf-8", "replace"), allowed_dirs=[path.parent])


def _read_xacro(path: Path) -> None:
    data = expand_xacro(path, {}, start=start_forked)
    robot_from_text(data.decode(), name=str(path), allowed_dirs=[path.parent])


def _read_mesh_map(path: Path) -> None:
    bodies_from_mesh_map(path.read_bytes().decode("utf-8", "replace"), allowed_dirs=[path.parent])


_PART_FILE = {"part.stl": _STL}


def _world_seeds() -> Sequence[bytes]:
    world = shipped("data", "worlds", "lumpectomy")
    return [(world / "world.yaml").read_bytes().replace(b"chest_wall.stl", b"part_of_world.stl")]


def _world_parser() -> FuzzedParser:
    mesh = shipped("data", "recorded_case", "tumor.stl").read_bytes()
    return FuzzedParser(
        "world_yaml", "world.yaml", open_world, _world_seeds, YAML, {"part_of_world.stl": mesh}
    )


PARSERS = (
    FuzzedParser(
        "urdf", "arm.urdf", load_robot, _urdf_seeds, (*TEXT, *[mutate_xml] * 15), _PART_FILE
    ),
    FuzzedParser(
        "robot_description",
        "arm.urdf",
        _read_received_urdf,
        lambda: [_URDF.encode()],
        (*TEXT, *[mutate_xml] * 15),
        _PART_FILE,
        names_file=False,
    ),
    FuzzedParser(
        "xacro",
        "arm.xacro",
        _read_xacro,
        lambda: [_XACRO.encode()],
        XACRO,
        {"part.xacro": _PART, "limits.yaml": b"max: 90.0\nnames: [a, b]\n"},
    ),
    FuzzedParser("adf", "arm.yaml", load_robot, _adf_seeds, YAML, _PART_FILE),
    FuzzedParser(
        "mesh_map",
        "map.txt",
        _read_mesh_map,
        lambda: [b"base:part.stl; left_arm : part.stl;"],
        TEXT,
        _PART_FILE,
        names_file=False,
    ),
    _world_parser(),
)
