import resource
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
from slicer import vtkMRMLScene

from app.geometry import Transform
from app.robot import Robot, load_robot
from app.scene import MarginGuardScene, SceneError
from app.scene.convert import numpy_array, world_points
from app.scene.robot_model import STALE_COLOR
from tests.scene.conftest import posed
from tests.scene.scene_content import set_poses

pytestmark = pytest.mark.slow

RAS_FROM_REFERENCE = posed("ras", "reference", [0.3, 0.2, 0.1], [7.0, 8.0, 9.0])
REFERENCE_FROM_BASE = posed("reference", "robot_base", [0.0, 0.1, 0.4], [-90.0, 30.0, -20.0])


@pytest.fixture
def scene():
    scene = MarginGuardScene(vtkMRMLScene(), ras_from_reference=RAS_FROM_REFERENCE)
    set_poses(scene, (), [REFERENCE_FROM_BASE])
    return scene


def test_names_parents_and_colors(scene, arm):
    model = scene.add_robot("one", arm, "robot_base")
    assert model.transforms["base"].GetName() == "BaseToRobotBase"
    assert model.transforms["fore_arm"].GetName() == "ForeArmToBase"
    fore = scene.scene.GetFirstNodeByName("fore_arm_model")
    assert fore is model.models["fore_arm"]
    assert fore.GetParentTransformNode() is model.transforms["fore_arm"]
    colors = numpy_array(fore.GetPolyData().GetCellData().GetArray("color"))
    assert np.array_equal(np.unique(colors, axis=0), [[0, 0, 255], [255, 0, 255]])
    assert (colors == [0, 0, 255]).all(axis=1).sum() == 12
    assert fore.GetDisplayNode().GetScalarVisibility()


def test_every_visual_of_a_link_is_in_its_model(scene, arm):
    points = world_points(scene.add_robot("one", arm, "robot_base").models["fore_arm"])
    base_from_link = arm.forward_kinematics({})["fore_arm"].renamed(target="robot_base")
    ras_from_link = RAS_FROM_REFERENCE @ REFERENCE_FROM_BASE @ base_from_link
    in_link = ras_from_link.inverse().apply(points)
    assert np.allclose(in_link.min(axis=0), [-7, -7, 0], atol=1e-3)
    assert np.allclose(in_link.max(axis=0), [7, 7, 70], atol=1e-3)


def test_root_link_named_as_the_base_frame_is_the_base(arm):
    scene = MarginGuardScene(vtkMRMLScene())
    set_poses(scene, (), [REFERENCE_FROM_BASE.renamed(source="base")])
    model = scene.add_robot("one", arm, "base")
    assert model.transforms["base"] is scene.tree.node("base")
    scene.remove_robot("one")
    assert scene.scene.GetFirstNodeByName("BaseToReference") is not None


def nodes_by_class(scene):
    everything = (scene.scene.GetNthNode(place) for place in range(scene.scene.GetNumberOfNodes()))
    return Counter(node.GetClassName() for node in everything)


def test_removed_robot_leaves_no_node(scene, arm, project_root):
    touch = load_robot(project_root / "data" / "robots" / "touch" / "touch.urdf")
    before = nodes_by_class(scene)
    scene.add_robot("left", arm, "robot_base")
    with_one = nodes_by_class(scene)
    for _ in range(10):
        scene.add_robot("right", touch, "robot_base")
        assert nodes_by_class(scene).total() > with_one.total() + 2 * len(touch.links)
        scene.remove_robot("right")
        assert nodes_by_class(scene) == with_one
    assert scene.scene.GetFirstNodeByName("upper_model") is scene.robots["left"].models["upper"]
    scene.remove_robot("left")
    assert nodes_by_class(scene) == before


def resident_mb():
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * resource.getpagesize() / 2**20


def test_robots_that_come_and_go_leave_no_memory(scene, example_urdfs):
    """A leak of the UR5's surfaces would be about 10 MB per round."""
    robot = load_robot(example_urdfs[0])

    def rounds(count):
        for _ in range(count):
            scene.add_robot("one", robot, "robot_base")
            scene.remove_robot("one")
        return resident_mb()

    settled = rounds(2)
    assert rounds(4) - settled < 3.0


def test_unknown_links_are_grey(scene, arm):
    model = scene.add_robot("one", arm, "robot_base")
    fore = model.models["fore_arm"].GetDisplayNode()
    own = fore.GetColor()
    model.set_known(False)
    assert fore.GetColor() == STALE_COLOR
    assert not fore.GetScalarVisibility()
    model.set_known(True)
    assert fore.GetColor() == own
    assert fore.GetScalarVisibility()


def test_translucent_visuals_keep_their_alpha(scene, arm):
    fore = arm.links[-1]
    glass = replace(fore.visuals[1], color=(1.0, 0.0, 1.0, 0.2))
    link = replace(fore, visuals=(fore.visuals[0], glass))
    robot = Robot("glass", (*arm.links[:-1], link), arm.joints)
    model = scene.add_robot("one", robot, "robot_base").models["fore_arm"]
    colors = numpy_array(model.GetPolyData().GetCellData().GetArray("color"))
    assert np.array_equal(np.unique(colors, axis=0), [[0, 0, 255, 255], [255, 0, 255, 51]])


def test_shapes_of_every_kind_are_shown_with_their_scale(scene, tmp_path):
    """Primitives and a mesh scaled by three factors, one of them a mirror; boxes by hand."""
    trimesh.creation.box((0.2, 0.1, 0.4)).export(tmp_path / "box.stl")
    (tmp_path / "kinds.urdf").write_text(
        """<robot name="kinds">
        <material name="blue"><color rgba="0 0 1 1"/></material>
        <link name="root">
          <visual><origin xyz="1 0 0"/><geometry><box size="0.2 0.4 0.6"/></geometry>
            <material name="blue"/></visual>
          <visual><geometry><sphere radius="0.05"/></geometry></visual>
          <visual><origin xyz="0 2 0" rpy="0 1.5707963267948966 0"/>
            <geometry><cylinder radius="0.1" length="1.0"/></geometry></visual>
          <visual><origin xyz="0 0 -1"/>
            <geometry><mesh filename="box.stl" scale="-0.5 2 1"/></geometry></visual>
        </link></robot>"""
    )
    robot = load_robot(tmp_path / "kinds.urdf")
    model = scene.add_robot("kinds", robot, "robot_base").models["root"]
    points = numpy_array(model.GetPolyData().GetPoints().GetData())
    expected = (
        ((900, -200, -300), (1100, 200, 300)),
        ((-50, -50, -50), (50, 50, 50)),
        ((-500, 1900, -100), (500, 2100, 100)),
        ((-50, -100, -1200), (50, 100, -800)),
    )
    found = 0
    for low, high in expected:
        inside = ((points >= np.array(low) - 1e-3) & (points <= np.array(high) + 1e-3)).all(axis=1)
        np.testing.assert_allclose(points[inside].min(axis=0), low, atol=1.0)
        np.testing.assert_allclose(points[inside].max(axis=0), high, atol=1.0)
        found += inside.sum()
    assert found == len(points)
    colors = numpy_array(model.GetPolyData().GetCellData().GetArray("color"))
    assert (colors == [0, 0, 255]).all(axis=1).sum() == 12  # the box alone is blue


def test_unknown_robots_links_and_frames_are_refused(scene, arm):
    model = scene.add_robot("one", arm, "robot_base")
    with pytest.raises(
        SceneError, match="robot 'one' is already in the scene; expected another name"
    ):
        scene.add_robot("one", arm, "robot_base")
    with pytest.raises(SceneError, match="frame 'elsewhere' has no pose"):
        scene.add_robot("two", arm, "elsewhere")
    with pytest.raises(SceneError, match="link 'leg' is not a link of the robot; expected one of"):
        model.set_links({"leg": Transform.identity("base", "leg")})
    with pytest.raises(SceneError, match="robot 'two' is not in the scene; expected one of"):
        scene.remove_robot("two")
