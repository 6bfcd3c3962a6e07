"""Ambiguous descriptions, which yourdfpy accepts, are refused with name and line."""

import pytest

from app.robot import JointType, RobotMeshError, UrdfError, load_robot

TWO = '<link name="a"/><link name="b"/>'


def joint(inside="", kind="fixed", links='<parent link="a"/><child link="b"/>'):
    return f'<joint name="j" type="{kind}">{links}{inside}</joint>'


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
        (
            TWO + joint('<origin xyz="1"/>'),
            "'xyz' of <origin> in line 3 is '1'; expected 3 dec",
        ),
        (TWO + joint('<origin xyz="1 0 0 5"/>'), "'xyz' of <origin> .* expected 3 decimal numbers"),
        (TWO + joint('<origin rpy="1_0 0 0"/>'), "'rpy' of <origin> .* expected 3 decimal numbers"),
        (TWO + joint('<axis xyz="0 0 1 1"/>', kind="continuous"), "'xyz' of <axis>"),
        (TWO + joint('<limit lower="1_0"/>', kind="revolute"), "'lower' of <limit> .* 1 decimal"),
        (TWO + joint('<origin xyz="1 0 0"/><origin/>'), "has 2 elements <origin>; expected one"),
        (TWO + joint('<parent link="a"/>'), "has 2 elements <parent>"),
        (
            '<link name="a"><collision><origin xyz="1"/><geometry><sphere radius="1"/></geometry>'
            "</collision></link>",
            "'xyz' of <origin>",
        ),
        (
            '<link name="a"><visual><geometry><box size="1 1 1 1"/></geometry></visual></link>',
            "'size' of <box>",
        ),
        (TWO, "a, b have no parent"),
        ('<link name="a"><visual/></link>', "<visual> in line 3 has the geometry none"),
        (
            '<link name="a"><collision><geometry><capsule/></geometry></collision></link>',
            "geometry capsule; expected one of mesh, box, cylinder, sphere",
        ),
        ('<link name="a"><visual><geometry><mesh/></geometry></visual></link>', "filename"),
        (
            '<link name="a"><collision><geometry><sphere radius="-1"/></geometry></collision>'
            "</link>",
            "sphere are .-1.0.; expected 1 numbers above 0",
        ),
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
    robot = load_robot(
        write_urdf(
            TWO
            + """<!-- a comment between -->
            <joint name="j" type="prismatic"><parent link="a"/><child link="b"/>
              <origin xyz="0.1 0.2 0.3" rpy="0 0 1.5707963267948966"/>
              <axis xyz="2 0 0"/><limit upper="0.05" effort="1" velocity="1"/>
            </joint>"""
        )
    )
    (read,) = robot.joints
    assert (read.type, read.parent, read.child) == (JointType.PRISMATIC, "a", "b")
    assert (read.lower, read.upper) == (0.0, 0.05)
    assert read.axis.tolist() == [1.0, 0.0, 0.0]
    assert read.origin.translation_mm.tolist() == [100.0, 200.0, 300.0]
    # The axis is the joint's x, which is parallel to y of the parent.
    place = robot.forward_kinematics({"j": 0.05})["b"].translation_mm
    assert place.tolist() == pytest.approx([100.0, 250.0, 300.0])
