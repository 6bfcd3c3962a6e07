"""Elements of a URDF have the values that yourdfpy, an independent reader, gives them.

Ambiguous descriptions, which yourdfpy accepts, are refused with name and line.
"""

import io
import math
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np
import pytest
import yourdfpy

from app.robot import JointType, RobotMeshError, UrdfError, load_robot
from app.robot.description.urdf import parse_urdf

TWO = '<link name="a"/><link name="b"/>'


def joint(inside="", kind="fixed", links='<parent link="a"/><child link="b"/>'):
    return f'<joint name="j" type="{kind}">{links}{inside}</joint>'


def link(inside):
    return f'<link name="a">{inside}</link>'


def collision(geometry, origin=""):
    return link(f"<collision>{origin}<geometry>{geometry}</geometry></collision>")


@pytest.mark.parametrize(
    ("body", "message"),
    [
        ("", "has no link"),
        ("<link/>", "<link> in line 3 has no name"),
        ('<link name="a"/>\n<link name="a"/>', "two links named 'a', in the lines 3 and 4"),
        (TWO + joint() + "\n" + joint(), "two joints named 'j', in the lines 3 and 4"),
        (TWO + joint(links='<child link="b"/>'), "'j' in line 3 names no parent link"),
        (TWO + joint(links='<parent link="a"/><child/>'), "names no child link"),
        (TWO + joint(kind="floating"), "type 'floating'; expected fixed, revolute"),
        (TWO + joint(kind="planar"), "type 'planar'"),
        (TWO + joint(kind="magic"), "type 'magic'"),
        (TWO + joint(kind="revolute"), "has no <limit>"),
        (TWO + joint("<mimic/>", kind="continuous"), "names no joint"),
        (TWO + joint('<origin xyz="0 zero 0"/>'), "cannot be read as URDF.*zero"),
        (TWO + joint('<origin xyz="0 nan 0"/>'), "not finite"),
        (TWO + joint('<axis xyz="0 0 0"/>', kind="continuous"), "axis of joint 'j'"),
        # yourdfpy reads (1, 1, 1), (1, 0, 0) and (10, 0, 0).
        (TWO + joint('<origin xyz="1"/>'), "'xyz' of <origin> in line 3 is '1'; expected 3 dec"),
        (TWO + joint('<origin xyz="1 0 0 5"/>'), "'xyz' of <origin> .* expected 3 decimal numbers"),
        (TWO + joint('<origin rpy="1_0 0 0"/>'), "'rpy' of <origin> .* expected 3 decimal numbers"),
        (TWO + joint('<axis xyz="0 0 1 1"/>', kind="continuous"), "'xyz' of <axis>"),
        (TWO + joint('<limit lower="1_0"/>', kind="revolute"), "'lower' of <limit> .* 1 decimal"),
        (TWO + joint('<origin xyz="1 0 0"/><origin/>'), "has 2 elements <origin>; expected one"),
        (TWO + joint('<parent link="a"/>'), "has 2 elements <parent>"),
        (collision('<sphere radius="1"/>', '<origin xyz="1"/>'), "'xyz' of <origin>"),
        (collision('<box size="1 1 1 1"/>'), "'size' of <box>"),
        (TWO, "a, b have no parent"),
        (link("<visual/>"), "<visual> in line 3 has the geometry none"),
        (collision("<capsule/>"), "geometry capsule; expected one of mesh, box, cylinder, sphere"),
        (collision("<mesh/>"), "filename"),
        (collision('<sphere radius="-1"/>'), "sphere are .-1.0.; expected 1 numbers above 0"),
        (link('<inertial><mass value="heavy"/></inertial>'), "cannot be read as URDF"),
        (link('<inertial><inertia ixx="x"/></inertial>'), "cannot be read as URDF"),
        (link('<inertial><origin rpy="0 0 up"/></inertial>'), "expected 3 decimal|cannot be read"),
        (
            '<xacro:arm xmlns:xacro="http://www.ros.org/wiki/xacro"/><link name="a"/>',
            "xacro element in line 3; expected a file that xacro",
        ),
        (
            '<material name="m"><color rgba="1 0 0"/></material><link name="a"/>',
            "color of material 'm'",
        ),
    ],
)
def test_ambiguous_description_is_refused(write_urdf, body, message):
    path = write_urdf(body)
    with pytest.raises((UrdfError, RobotMeshError), match=message) as caught:
        load_robot(path)
    assert "\n" not in str(caught.value)
    assert isinstance(caught.value, RobotMeshError) or str(path) in str(caught.value)


def test_other_root_element_and_nameless_robot_are_refused(tmp_path):
    path = tmp_path / "model.urdf"
    path.write_text("<sdf/>")
    with pytest.raises(UrdfError, match="holds <sdf> in line 1"):
        load_robot(path)
    path.write_text("<robot><link name='a'/></robot>")
    with pytest.raises(UrdfError, match="has no name"):
        load_robot(path)


def test_joints_are_read_with_all_their_elements(write_urdf):
    elements = """<!-- a comment between -->
        <origin xyz="0.1 0.2 0.3" rpy="0 0 1.5707963267948966"/>
        <axis xyz="2 0 0"/><limit upper="0.05" effort="1" velocity="1"/>"""
    robot = load_robot(write_urdf(TWO + joint(elements, kind="prismatic")))
    (read,) = robot.joints
    assert (read.type, read.parent, read.child) == (JointType.PRISMATIC, "a", "b")
    assert (read.lower, read.upper) == (0.0, 0.05)
    assert read.axis.tolist() == [1.0, 0.0, 0.0]
    assert read.origin.translation_mm.tolist() == [100.0, 200.0, 300.0]
    # The axis is the joint's x, which is parallel to y of the parent.
    place = robot.forward_kinematics({"j": 0.05})["b"].translation_mm
    assert place.tolist() == pytest.approx([100.0, 250.0, 300.0])


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


def test_every_element_has_the_values_of_yourdfpy():
    ours = parse_urdf(EVERY_ELEMENT, "all.urdf")
    assert [len(ours.links), len(ours.joints), len(ours.materials)] == [4, 3, 2]
    assert_equal(ours, by_yourdfpy(EVERY_ELEMENT), "robot")


def test_shipped_robot_has_the_values_of_yourdfpy(touch_urdf):
    text = touch_urdf.read_bytes()
    assert_equal(parse_urdf(text, "touch.urdf"), by_yourdfpy(text), "robot")
