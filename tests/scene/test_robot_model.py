from pathlib import Path

import numpy as np
import pytest
from slicer import vtkMRMLScene

from app.geometry import Transform
from app.robot import Robot, load_robot
from app.scene import MarginGuardScene, SceneError
from app.scene.convert import numpy_array, world_matrix, world_points

RAS_FROM_REFERENCE = Transform.from_rotation_vector(
    [0.3, 0.2, 0.1], [7.0, 8.0, 9.0], target="ras", source="reference"
)
REFERENCE_FROM_BASE = Transform.from_rotation_vector(
    [0.0, 0.1, 0.4], [-90.0, 30.0, -20.0], target="reference", source="robot_base"
)


@pytest.fixture
def scene() -> MarginGuardScene:
    scene = MarginGuardScene(vtkMRMLScene(), ras_from_reference=RAS_FROM_REFERENCE)
    scene.set_poses((), [REFERENCE_FROM_BASE])
    return scene


def assert_links_where_kinematics_puts_them(scene: MarginGuardScene, robot: Robot) -> None:
    model = scene.add_robot("one", robot, "robot_base")
    ras_from_base = (RAS_FROM_REFERENCE @ REFERENCE_FROM_BASE).matrix
    rng = np.random.default_rng(5)
    for _ in range(50):
        names = robot.actuated_joint_names
        links = robot.forward_kinematics(
            dict(zip(names, rng.uniform(-1.5, 1.5, len(names)), strict=True))
        )
        model.set_links(links)
        for name, root_from_link in links.items():
            wanted = ras_from_base @ root_from_link.matrix
            assert np.allclose(world_matrix(model.transforms[name]), wanted, rtol=0, atol=1e-6)


def test_small_arm(scene: MarginGuardScene, arm: Robot) -> None:
    assert_links_where_kinematics_puts_them(scene, arm)


def test_our_arm(scene: MarginGuardScene, project_root: Path) -> None:
    urdf = project_root / "data" / "robots" / "touch" / "touch.urdf"
    robot = load_robot(urdf)
    assert_links_where_kinematics_puts_them(scene, robot)
    shown = {link.name for link in robot.links if link.visuals}
    assert set(scene.robots["one"].models) == shown


def test_omni(scene: MarginGuardScene, shared_data: Path) -> None:
    folder = shared_data / "omni"
    robot = load_robot(folder / "urdf" / "omni.urdf", package_dirs=(folder,))
    assert_links_where_kinematics_puts_them(scene, robot)
    assert len(scene.robots["one"].models) == 7


def test_names_parents_and_colors(scene: MarginGuardScene, arm: Robot) -> None:
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


def test_every_visual_of_a_link_is_there(scene: MarginGuardScene, arm: Robot) -> None:
    points = world_points(scene.add_robot("one", arm, "robot_base").models["fore_arm"])
    base_from_link = arm.forward_kinematics({})["fore_arm"].renamed(target="robot_base")
    ras_from_link = RAS_FROM_REFERENCE @ REFERENCE_FROM_BASE @ base_from_link
    in_link = ras_from_link.inverse().apply(points)
    assert np.allclose(in_link.min(axis=0), [-7, -7, 0], atol=1e-3)
    assert np.allclose(in_link.max(axis=0), [7, 7, 70], atol=1e-3)


def test_root_link_named_as_the_base_frame_is_the_base(arm: Robot) -> None:
    scene = MarginGuardScene(vtkMRMLScene())
    scene.set_poses((), [REFERENCE_FROM_BASE.renamed(source="base")])
    model = scene.add_robot("one", arm, "base")
    assert model.transforms["base"] is scene.tree.node("base")
    scene.remove_robot("one")
    assert scene.scene.GetFirstNodeByName("BaseToReference") is not None


def test_two_robots_and_removal_without_leftovers(scene: MarginGuardScene, arm: Robot) -> None:
    nodes = scene.scene.GetNumberOfNodes()
    scene.add_robot("left", arm, "robot_base")
    with_one = scene.scene.GetNumberOfNodes()
    for _ in range(100):
        scene.add_robot("right", arm, "robot_base")
        assert scene.scene.GetNumberOfNodes() == 2 * with_one - nodes
        scene.remove_robot("right")
        assert scene.scene.GetNumberOfNodes() == with_one
    assert scene.scene.GetFirstNodeByName("upper_model") is scene.robots["left"].models["upper"]
    scene.remove_robot("left")
    assert scene.scene.GetNumberOfNodes() == nodes


def test_robots_that_do_not_fit_are_refused(scene: MarginGuardScene, arm: Robot) -> None:
    model = scene.add_robot("one", arm, "robot_base")
    with pytest.raises(SceneError, match="robot 'one' is in the scene already"):
        scene.add_robot("one", arm, "robot_base")
    with pytest.raises(SceneError, match="frame 'elsewhere' has no pose"):
        scene.add_robot("two", arm, "elsewhere")
    with pytest.raises(SceneError, match="link 'leg' is not of the robot"):
        model.set_links({"leg": Transform.identity("base", "leg")})
    with pytest.raises(SceneError, match="no robot 'two'"):
        scene.remove_robot("two")
