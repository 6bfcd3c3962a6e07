"""Elements of a URDF have the values that Pinocchio gives them, by a parser of its own.

Ambiguous descriptions, which yourdfpy accepts, are refused with name and line.
"""

import itertools

import numpy as np
import pinocchio as pin
import pytest
import trimesh

from app.robot import JointType, RobotMeshError, UrdfError, load_robot

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
        (
            '<link name="a"/>\n<link name="a"/>',
            "two links named 'a', in the lines 3 and 4; expected different names",
        ),
        (
            TWO + joint() + "\n" + joint(),
            "two joints named 'j', in the lines 3 and 4; expected different names",
        ),
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
        (link('<inertial><origin rpy="0 0 up"/></inertial>'), "cannot be read as URDF"),
        (link('<inertial><origin xyz="1"/></inertial>'), "'xyz' of <origin> in line 3 is '1'; exp"),
        (TWO + joint('<dynamics damping=""/>'), "cannot be read as URDF: could not convert"),
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


def test_moment_of_inertia_that_is_missing_is_not_a_number(write_urdf):
    """yourdfpy gives it the value 1 or 0."""
    text = '<inertial><mass value="2"/><inertia ixx="3"/></inertial>'
    inertia = load_robot(write_urdf(link(text))).links[0].inertia
    assert inertia.mass_kg == 2.0
    assert np.isfinite(inertia.tensor_kg_m2).sum() == 1


EVERY_ELEMENT = """
  <!-- a comment -->
  <material name="red"><color rgba="1 0 0 0.5"/></material>
  <link name="a">
    <inertial><origin xyz="0.1 0 0" rpy="0 0 1"/><mass value="2"/>
      <inertia ixx="1" ixy="0.2" ixz="0.3" iyy="1.5" iyz="0.1" izz="2"/></inertial>
    <visual name="v"><!-- another --><origin xyz="0.1 -2 3e-3" rpy="0.1 -0.2 3"/>
      <geometry><!-- one more --><box size="1 2 3"/></geometry><material name="red"/></visual>
    <visual><geometry><mesh filename="m.stl" scale="-1 1 1"/></geometry>
      <material name="blue"><color rgba="0 0 1 1"/></material></visual>
    <collision><origin/><geometry><cylinder radius="0.1" length="2"/></geometry></collision>
    <collision><origin xyz="1 2 3"/><geometry><sphere radius="3"/></geometry></collision>
    <collision><geometry><mesh filename="m.stl" scale="0.1 0.2 0.3"/></geometry></collision>
  </link>
  <link name="b"/><link name="c"/><link name="d"/>
  <joint name="j" type="revolute"><parent link="a"/><child link="b"/>
    <origin xyz="0 0 1" rpy="0.1 -1.2 3"/><axis xyz="0 0 -1"/>
    <limit lower="-1" upper="2.5" effort="3" velocity="4"/><calibration rising="0"/>
    <safety_controller k_velocity="1"/><dynamics damping="5" friction="6"/></joint>
  <joint name="k" type="prismatic"><parent link="b"/><child link="c"/>
    <limit upper="1" effort="7" velocity="8"/><mimic joint="j" multiplier="-2" offset="0.5"/>
    <dynamics friction="9"/></joint>
  <joint name="l" type="continuous"><parent link="c"/><child link="d"/></joint>"""


def assert_has_the_values_of_pinocchio(urdf):
    """Compare joints, masses and the shapes of the root; urdfdom reads the file for Pinocchio."""
    robot, model = load_robot(urdf), pin.buildModelFromUrdf(str(urdf))
    for joint in (joint for joint in robot.joints if joint.moves):
        number = model.getJointId(joint.name)
        peer, place = model.joints[number], model.jointPlacements[number].homogeneous
        np.testing.assert_allclose(joint.origin.matrix, in_mm(place), atol=1e-9)
        ours, at = joint.dynamics, peer.idx_v
        assert (ours.damping, ours.friction) == (model.damping[at], model.upperDryFrictionLimit[at])
        if joint.type is not JointType.CONTINUOUS:
            drive = (model.upperEffortLimit[at], model.upperVelocityLimit[at])
            assert (ours.effort, ours.velocity) == drive
            limits = (model.lowerPositionLimit, model.upperPositionLimit)
            assert [joint.lower, joint.upper] == [limit[peer.idx_q] for limit in limits]
    for link in (link for link in robot.links if link.inertia):
        ours, peer = link.inertia, model.frames[model.getBodyId(link.name)].inertia
        place = ours.link_from_inertial
        assert ours.mass_kg == peer.mass
        np.testing.assert_allclose(place.translation_mm, 1000.0 * peer.lever)
        turned = place.rotation @ ours.tensor_kg_m2 @ place.rotation.T
        np.testing.assert_allclose(turned, peer.inertia)
    (root,) = (link for link in robot.links if link.name == robot.root_link)
    for kind, shapes in (("VISUAL", root.visuals), ("COLLISION", root.collisions)):
        kind = getattr(pin.GeometryType, kind)
        found = pin.buildGeomFromUrdf(
            model, str(urdf), kind, package_dirs=[str(urdf.parent)]
        ).geometryObjects
        peers = [each for each in found if model.frames[each.parentFrame].name == root.name]
        for shape, peer in zip(shapes, peers, strict=True):
            peer.geometry.computeLocalAABB()
            box = peer.geometry.aabb_local
            corners = itertools.product(*zip(box.min_, box.max_, strict=True))
            placed = 1000.0 * np.array([peer.placement.act(np.array(each)) for each in corners])
            bounds = [placed.min(axis=0), placed.max(axis=0)]
            np.testing.assert_allclose(shape.mesh.bounds_mm, bounds, atol=1e-9)
            if peer.overrideMaterial:
                np.testing.assert_allclose(shape.color, peer.meshColor)


def in_mm(matrix):
    return np.vstack([matrix[:3] * [1, 1, 1, 1000], matrix[3:]])


def test_every_element_has_the_value_that_pinocchio_reads(write_urdf, tmp_path):
    trimesh.creation.box((1, 2, 3)).export(tmp_path / "m.stl")
    assert_has_the_values_of_pinocchio(write_urdf(EVERY_ELEMENT))


def test_shipped_robot_has_the_values_that_pinocchio_reads(touch_urdf):
    assert_has_the_values_of_pinocchio(touch_urdf)
