"""AMBF files compared with the values of their YAML text."""

import math

import numpy as np
import pytest
import trimesh
import yaml
from scipy.spatial.transform import Rotation

from app.robot import (
    AdfError,
    JointType,
    RobotMeshError,
    bodies_from_mesh_map,
    load_adf,
    load_robot,
    parse_mesh_map,
)
from tests.oracles.ambf_poses import world_from_body
from tests.robot.description.own_arm import write_arm


@pytest.fixture(scope="module", params=["an arm of our own", "KUKA"])
def arm_file(request, tmp_path_factory):
    """Our own arm, and the KUKA of AMBF's repository on development machines."""
    if request.param == "KUKA":
        folder = request.getfixturevalue("shared_data")
        return folder / "ambf_kuka" / "blender-kuka.yaml"
    return write_arm(tmp_path_factory.mktemp("adf"))


@pytest.fixture(scope="module")
def arm(arm_file):
    return load_robot(arm_file)


def test_bodies_of_an_arm_are_at_their_locations(arm, arm_file):
    document = yaml.safe_load(arm_file.read_text())
    links = arm.forward_kinematics({})
    assert set(links) == {"world", *(document[key]["name"] for key in document["bodies"])}
    for key in document["bodies"]:
        pose, expected = links[document[key]["name"]], world_from_body(document[key]["location"])
        np.testing.assert_allclose(pose.matrix, expected, rtol=0, atol=1e-9)


def test_joints_of_an_arm_rotate_about_axis_and_pivot_of_the_parent(arm, arm_file):
    """The loader uses axis and pivot of the child; those of the parent are the same line."""
    document = yaml.safe_load(arm_file.read_text())
    angle = 0.7
    at_zero = arm.forward_kinematics({})
    for key in document["joints"]:
        joint = document[key]
        parent, child = document[joint["parent"]]["name"], document[joint["child"]]["name"]
        moved = arm.forward_kinematics({joint["name"]: angle})
        before = (at_zero[parent].inverse() @ at_zero[child]).matrix
        turned = (moved[parent].inverse() @ moved[child]).matrix @ np.linalg.inv(before)
        axis = np.array([joint["parent axis"][each] for each in "xyz"])
        pivot = np.array([1000.0 * joint["parent pivot"][each] for each in "xyz"])
        found = Rotation.from_matrix(turned[:3, :3]).as_rotvec()
        np.testing.assert_allclose(found, angle * axis, atol=2e-4)  # angles with three decimals
        np.testing.assert_allclose(turned[:3, :3] @ pivot + turned[:3, 3], pivot, atol=0.1)


def test_arm_has_limits_colours_and_meshes(arm, arm_file):
    document = yaml.safe_load(arm_file.read_text())
    joint = arm.joints[-1]
    assert (joint.type, joint.lower, joint.upper) == (JointType.REVOLUTE, -3.054, 3.054)
    for link in arm.links[1:]:
        peer = trimesh.load_mesh(arm_file.parent / "meshes" / "low_res" / f"{link.name}.STL")
        (visual,), (collision,) = link.visuals, link.collisions
        diffuse = document[f"BODY {link.name}"]["color components"]["diffuse"]
        assert visual.color == (diffuse["r"], diffuse["g"], diffuse["b"], 1.0)
        for shape in (visual, collision):
            np.testing.assert_allclose(shape.mesh.bounds_mm, 1000.0 * peer.bounds, atol=1e-3)


def test_mesh_found_elsewhere_is_a_warning(arm, arm_file):
    name = arm.links[-1].name
    about_last = [warning for warning in arm.warnings if f"{name}.STL" in warning]
    for warning, resolution in zip(about_last, ("high", "low"), strict=True):
        assert f"/{resolution}_res/{name}.STL' of body '{name}' not found" in warning
        used = arm_file.parent / "meshes" / "low_res" / f"{name}.STL"
        assert warning.endswith(f"{str(used)!r} used instead")


def test_mesh_map_gives_the_bodies_of_an_arm(arm, arm_file):
    folder = arm_file.parent / "meshes" / "low_res"
    names = [link.name for link in arm.links[1:]]
    text = "".join(f"{name}:{folder / name}.STL;" for name in names)
    robot = bodies_from_mesh_map(text, allowed_dirs=[folder])
    assert [link.name for link in robot.links] == ["world", *names]
    for link, peer in zip(robot.links[1:], arm.links[1:], strict=True):
        mesh, other = link.visuals[0].mesh, peer.visuals[0].mesh
        np.testing.assert_array_equal(mesh.vertices_mm, other.vertices_mm)
    with pytest.raises(RobotMeshError, match="outside the allowed mesh folders"):
        bodies_from_mesh_map(text)


@pytest.fixture
def write_adf(tmp_path):
    def write(bodies, joints=(), **settings):
        bodies = {f"BODY {body['name']}": body for body in bodies}
        joints = {f"JOINT {joint['name']}": joint for joint in joints}
        listed = {"bodies": list(bodies), "joints": list(joints)}
        path = tmp_path / "model.yaml"
        path.write_text(yaml.safe_dump({**listed, **settings, **bodies, **joints}))
        return path

    return write


def at(x, y, z, r=0.0, p=0.0, yaw=0.0):
    return {"position": xyz(x, y, z), "orientation": {"r": r, "p": p, "y": yaw}}


def xyz(x, y, z):
    return {"x": x, "y": y, "z": z}


def test_orientation_is_about_fixed_axes(write_adf):
    """Roll about x, then pitch about y, then yaw about z, of the world."""
    roll, pitch, yaw = 0.3, 0.5, -0.7
    body = {"name": "x", "location": at(0.1, 0.2, 0.3, roll, pitch, yaw)}
    (c, s), (cp, sp), (cy, sy) = ((math.cos(a), math.sin(a)) for a in (roll, pitch, yaw))
    about_x = np.array([[1, 0, 0], [0, c, -s], [0, s, c]])
    about_y = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    about_z = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
    pose = load_adf(write_adf([body])).forward_kinematics({})["x"]
    np.testing.assert_allclose(pose.rotation, about_z @ about_y @ about_x, atol=1e-12)
    np.testing.assert_allclose(pose.translation_mm, [100.0, 200.0, 300.0])


def joint(kind="revolute", parent="BODY left arm", child="BODY hand", **more):
    return {
        "name": "wrist roll", "parent": parent, "child": child, "type": kind,
        "parent axis": xyz(0, 0, 1), "parent pivot": xyz(0.3, 0, 0),
        "child axis": xyz(0, 0, 1), "child pivot": xyz(-0.1, 0, 0),
        **more,
    }  # fmt: skip


ARM = {"name": "left arm", "location": at(1, 2, 3, yaw=math.pi / 2)}
HAND = {"name": "hand", "location": at(1, 2.4, 3, yaw=math.pi / 2)}


def test_joint_rotates_about_its_pivot_and_names_lose_their_spaces(write_adf):
    robot = load_adf(write_adf([ARM, HAND], [joint()]))
    assert robot.warnings == ()
    assert robot.actuated_joint_names == ("wristroll",)
    assert robot.joints[-1].type is JointType.CONTINUOUS
    turned = robot.forward_kinematics({"wristroll": math.pi})
    # The pivot is at (1, 2.3, 3). The hand, 0.1 m behind it, moves to the other side.
    np.testing.assert_allclose(turned["leftarm"].translation_mm, [1000, 2000, 3000], atol=1e-9)
    np.testing.assert_allclose(turned["hand"].translation_mm, [1000, 2200, 3000], atol=1e-9)
    found = robot.inverse_kinematics("hand", turned["hand"], seed={"wristroll": 2.0})
    assert found["wristroll"] == pytest.approx(math.pi)


def test_prismatic_joint_slides_and_keeps_its_limits(write_adf):
    slide = joint("prismatic", **{"joint limits": {"low": -0.1, "high": 0.2}})
    robot = load_adf(write_adf([ARM, HAND], [slide]))
    assert (robot.joints[-1].lower, robot.joints[-1].upper) == (-0.1, 0.2)
    moved = robot.forward_kinematics({"wristroll": 0.05})["hand"]
    np.testing.assert_allclose(moved.translation_mm, [1000, 2400, 3050], atol=1e-9)


def test_primitives_have_scale_offsets_and_colours(write_adf):
    body = {
        "name": "tool", "location": at(0, 0, 0), "scale": 2.0,
        "shape": "Cylinder", "geometry": {"radius": 0.01, "height": 0.1, "axis": "x"},
        "collision shape": "BOX", "collision geometry": {"x": 0.1, "y": 0.2, "z": 0.3},
        "inertial offset": at(0.5, 0, 0, r=math.pi / 2), "color rgba": {"r": 1, "g": 0, "b": 0},
    }  # fmt: skip
    tool = load_adf(write_adf([body])).links[1]
    np.testing.assert_allclose(tool.visuals[0].mesh.bounds_mm[1], [100, 20, 20], atol=0.1)
    assert tool.visuals[0].color == (1, 0, 0, 1)
    lower, upper = tool.collisions[0].mesh.bounds_mm
    np.testing.assert_allclose(lower, [400, -300, -200], atol=1e-9)
    np.testing.assert_allclose(upper, [600, 300, 200], atol=1e-9)


def test_joint_decides_where_locations_contradict_its_pivots(write_adf):
    """The simulator pulls the bodies together; the joint's positions are those of its frames."""
    robot = load_adf(write_adf([ARM, {**HAND, "location": at(1, 2.5, 3)}], [joint()]))
    message = "'leftarm' and 'hand': with the bodies at their locations the pivots are 224 mm"
    assert message in robot.warnings[0]
    hand = robot.forward_kinematics({})["hand"]
    np.testing.assert_allclose(hand.translation_mm, [1000, 2400, 3000], atol=1e-9)


@pytest.mark.parametrize("key", ["joint offset", "child offset", "offset"])
def test_offset_turns_the_child_about_the_axis_of_the_joint(write_adf, key):
    robot = load_adf(write_adf([ARM, HAND], [joint(**{key: math.pi / 2})]))
    assert "90 degrees from position 0" in robot.warnings[0]
    hand = robot.forward_kinematics({})["hand"]
    np.testing.assert_allclose(hand.translation_mm, [900, 2300, 3000], atol=1e-9)


def test_opposite_axes_turn_as_in_the_simulator(write_adf):
    """By pi about child axis x X: about y where the child's z axis is along -z of the parent."""
    flipped = joint(**{"parent axis": xyz(0, 0, -1)})
    robot = load_adf(write_adf([ARM, HAND], [flipped]))
    in_arm = robot.forward_kinematics({})["leftarm"].rotation.T
    turned = in_arm @ robot.forward_kinematics({})["hand"].rotation
    np.testing.assert_allclose(turned, np.diag([-1.0, 1.0, -1.0]), atol=1e-9)


def test_body_that_hangs_on_a_point_turns_about_three_axes(write_adf):
    robot = load_adf(write_adf([ARM, HAND], [joint("p2p")]))
    assert robot.actuated_joint_names == ("wristroll-x", "wristroll-y", "wristroll-z")
    assert "the only one of body 'hand', is modelled as" in robot.warnings[0]
    turned = robot.forward_kinematics({"wristroll-z": math.pi})
    np.testing.assert_allclose(turned["hand"].translation_mm, [1000, 2200, 3000], atol=1e-9)
    turned = robot.forward_kinematics({"wristroll-y": math.pi / 2})
    np.testing.assert_allclose(turned["hand"].translation_mm, [1000, 2300, 2900], atol=1e-9)


@pytest.mark.parametrize(("x", "names"), [(0, ["world", "leftarm"]), (1, ["world", "world-body"])])
def test_body_named_world_is_the_root_or_beside_it(write_adf, x, names):
    world = {"name": "world", "mesh": "", "location": at(x, 0, 0), "shape": "Box",
             "geometry": {"x": 1, "y": 1, "z": 1}}  # fmt: skip
    arm = {**ARM, "mesh": ""}
    robot = load_adf(write_adf([world, arm], [joint("fixed", "BODY world", "BODY left arm")]))
    assert [link.name for link in robot.links][:2] == names
    bodies = {link.name: link for link in robot.links}
    assert len(bodies[names[x]].visuals) == 1
    assert bodies["leftarm"].visuals == ()
    arm_pose = robot.forward_kinematics({})["leftarm"]
    np.testing.assert_allclose(arm_pose.translation_mm, [1000, 2000, 3000], atol=1e-9)


ROUND, FLAT = math.pi * 100, 1e7 * 1e3
PRIMITIVES = [
    (
        *("CAPSULE", {"radius": 0.01, "height": 0.1}),
        *([-10, -10, -60], [10, 10, 60], ROUND * 100 + 4 / 3 * ROUND * 10),
    ),
    (*("CONE", {"radius": 0.01, "height": 0.06}), *([-10, -10, -30], [10, 10, 30], ROUND * 60 / 3)),
    (
        *("Cone", {"radius": 0.01, "height": 0.06, "axis": "x"}),
        *([-30, -10, -10], [30, 10, 10], ROUND * 60 / 3),
    ),
    (
        *("PLANE", {"normal": xyz(0, 0, 2), "offset": 0.5}),
        *([-5000, -5000, 400], [5000, 5000, 500], FLAT),
    ),
    ("plane", {"normal": xyz(-1, 0, 0)}, [0, -5000, -5000], [100, 5000, 5000], FLAT),
]


@pytest.mark.parametrize(("shape", "geometry", "low", "high", "volume_mm3"), PRIMITIVES)
def test_primitives_have_the_sizes_of_the_simulator(
    write_adf, shape, geometry, low, high, volume_mm3
):
    form = {"collision shape": shape, "collision geometry": geometry}
    robot = load_adf(write_adf([{**ARM, "location": at(0, 0, 0), **form}]))
    (collision,) = robot.links[1].collisions
    np.testing.assert_allclose(collision.mesh.bounds_mm, [low, high], atol=1e-9)
    volume = collision.mesh.require_closed("x").signed_volume_mm3
    assert volume == pytest.approx(volume_mm3, rel=0.01)
    is_plane = shape.lower() == "plane"
    assert any("a plane is infinite" in each for each in robot.warnings) == is_plane


def test_missing_mesh_for_collision_is_an_error_or_left_out(write_adf):
    path = write_adf([{**ARM, "mesh": "arm.STL"}], **{"high resolution path": "high/"})
    with pytest.raises(RobotMeshError, match=r"'high/arm.STL' of body 'leftarm' not found"):
        load_adf(path)
    robot = load_adf(write_adf([{**ARM, "mesh": "arm.STL"}]), require_meshes=False)
    assert robot.links_without_collision == ("leftarm",)
    assert "collision shapes of body 'leftarm' left out: mesh 'arm.STL'" in robot.warnings[-1]


BACK = {**joint(parent="BODY hand", child="BODY left arm"), "name": "back"}


@pytest.mark.parametrize(
    ("bodies", "joints", "message"),
    [
        ([ARM, HAND], [joint("6dof")], "between 'leftarm' and 'hand' has the type '6dof'"),
        ([ARM], [joint()], "child is 'BODY hand'; expected one of BODY left arm"),
        ([ARM, HAND], [joint(child="BODY left arm")], "parent and child are 'leftarm'"),
        ([ARM, HAND], [joint(), BACK], "'hand', 'leftarm' are children of each other in a loop"),
        ([ARM, {**ARM, "name": "leftarm"}], [], "are both named 'leftarm'"),
        ([{**ARM, "scale": 0}], [], "'scale' is 0"),
        ([{**ARM, "scale": [1, 2]}], [], "'scale' is"),
        ([{**ARM, "location": {"position": {"x": 1, "y": 2}}}], [], "'z' is None; expected a fin"),
        ([{**ARM, "location": at(math.nan, 0, 0)}], [], "'x' is nan"),
        ([ARM, HAND], [joint(**{"child axis": xyz(0, 0, 0)})], "expected a direction"),
        ([{**ARM, "color rgba": {"r": 2, "g": 0, "b": 0}}], [], "expected 0 to 1"),
    ],
)
def test_malformed_section_is_named_in_one_line(write_adf, bodies, joints, message):
    with pytest.raises(AdfError, match=message) as refused:
        load_adf(write_adf(bodies, joints))
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[]", "is not an ADF"),
        ("bodies: [a]", "has no such section"),
        ("bodies: [a]\na: {}\na: {}", "duplicate key 'a', first in line 2"),
        ("bodies: [a, a]\na: {name: a}", "twice in 'bodies'"),
        ("bodies: [a]\na: {scale: 010}", "line 2: '010' is an ambiguous number"),
        ("bodies: [a]\na: {scale: 1:30.0}", "line 2: '1:30.0' is an ambiguous number"),
        ("bodies: [a]\nb: &b {name: a}\na: {<<: *b}", "merge key"),
        ("bodies: !!python/object/apply:os.system [ls]", "the tag .* is not allowed"),
        ("a: " + "[" * 100, "nested deeper"),
        ("bodies: [a]\na: {name: [" + "x, " * 10_000 + "x]}", "expected a text"),
        ("bodies: " + "x" * 3_000_000, "more than the 2097152 bytes"),
    ],
)
def test_malformed_file_is_refused_in_one_line(tmp_path, text, message):
    path = tmp_path / "model.yaml"
    path.write_text(text)
    with pytest.raises(AdfError, match=message) as refused:
        load_adf(path)
    assert len(str(refused.value)) < 400
    assert "\n" not in str(refused.value)


def test_mesh_map_is_parsed():
    assert parse_mesh_map("a:/x/a.stl; b :/y:z/b.stl;") == {"a": "/x/a.stl", "b": "/y:z/b.stl"}
    for text, message in (
        ("", "is empty"),
        ("a", "entry 'a'"),
        (":/x", "entry ':/x'"),
        ("a:/x;a:/y", "'a' twice"),
        ("x" * 2_000_000, "2000000 characters"),
    ):
        with pytest.raises(AdfError, match=message):
            parse_mesh_map(text)
