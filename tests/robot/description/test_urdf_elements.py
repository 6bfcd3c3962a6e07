"""The elements of a URDF have the values that yourdfpy, an independent reader, gives them."""

import io
import math
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yourdfpy

from app.robot import UrdfError
from app.robot.description.urdf import parse_urdf

EVERY_ELEMENT = b"""<robot name="all">
  <!-- a comment -->
  <material name="red"><color rgba="1 0 0 0.5"/></material>
  <material name="named"/>
  <link name="a">
    <inertial><origin rpy="0 0 1"/><mass value="2"/>
      <inertia ixx="1" ixy="0.2" ixz="0.3" iyy="1.5" iyz="0.1" izz="2"/></inertial>
    <visual name="v"><!-- another --><origin xyz="0.1 -2 3e-3" rpy="0.1 -0.2 3"/>
      <geometry><!-- one more --><box size="1 2 3"/></geometry><material name="red"/></visual>
    <visual><geometry><mesh filename="package://p/m.stl" scale="-1 1 1"/></geometry>
      <material name="blue"><color rgba="0 0 1 1"/></material></visual>
    <collision><origin/><geometry><cylinder radius="0.1" length="2"/></geometry></collision>
    <collision><geometry><sphere radius="3"/></geometry></collision>
    <collision><geometry><mesh filename="m.obj" scale="0.001"/></geometry></collision>
    <collision><geometry><mesh filename="m.dae"/></geometry></collision>
  </link>
  <link name="b"/><link name="c"/><link name="d"/>
  <joint name="j" type="revolute"><parent link="a"/><child link="b"/>
    <origin xyz="0 0 1" rpy="0 -1.5707963267948966 0"/><axis xyz="0 0 -1"/>
    <limit lower="-1" upper="2.5" effort="1" velocity="1"/><calibration rising="0"/>
    <safety_controller k_velocity="1"/><dynamics damping="1"/></joint>
  <joint name="k" type="prismatic"><parent link="b"/><child link="c"/><limit upper="1"/>
    <mimic joint="j" multiplier="-2" offset="0.5"/></joint>
  <joint name="l" type="continuous"><parent link="c"/><child link="d"/><mimic joint="j"/></joint>
</robot>"""


def assert_equal(ours: Any, theirs: Any, place: str) -> None:
    """Compare values by name and to the last bit; theirs may have more fields."""
    if is_dataclass(ours):
        for field in fields(ours):
            name = f"{place}.{field.name}"
            assert_equal(getattr(ours, field.name), getattr(theirs, field.name), name)
    elif isinstance(ours, list):
        assert len(ours) == len(theirs), place
        for number, (one, other) in enumerate(zip(ours, theirs, strict=True)):
            assert_equal(one, other, f"{place}[{number}]")
    elif isinstance(ours, np.ndarray):
        assert ours.shape == theirs.shape and ours.tobytes() == theirs.tobytes(), place
    elif isinstance(ours, float):
        other = float(theirs)  # yourdfpy leaves the losses of joints as text
        assert ours == other or (math.isnan(ours) and math.isnan(other)), place
    else:
        assert ours == theirs, place


def by_yourdfpy(text: bytes) -> Any:
    return yourdfpy.URDF.load(io.BytesIO(text), build_scene_graph=False, load_meshes=False).robot


def test_every_element_has_the_values_of_yourdfpy() -> None:
    ours = parse_urdf(EVERY_ELEMENT, "all.urdf")
    assert [len(ours.links), len(ours.joints), len(ours.materials)] == [4, 3, 2]
    assert_equal(ours, by_yourdfpy(EVERY_ELEMENT), "robot")


@pytest.mark.parametrize("name", ["touch/touch.urdf"])
def test_shipped_robot_has_the_values_of_yourdfpy(project_root: Path, name: str) -> None:
    text = (project_root / "data" / "robots" / name).read_bytes()
    assert_equal(parse_urdf(text, name), by_yourdfpy(text), "robot")


@pytest.mark.parametrize(
    "element",
    [
        '<inertial><mass value="heavy"/></inertial>',
        '<inertial><inertia ixx="x"/></inertial>',
        '<inertial><origin rpy="0 0 up"/></inertial>',
    ],
)
def test_numbers_that_are_not_used_must_be_numbers(element: str) -> None:
    text = f'<robot name="r"><link name="a">{element}</link></robot>'.encode()
    with pytest.raises(UrdfError, match=r"cannot be read as URDF|expected 3 decimal numbers"):
        parse_urdf(text, "r.urdf")
