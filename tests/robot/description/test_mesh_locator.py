"""Where mesh names lead, and where they must not."""

import pytest

from app.files.packages import PROJECT_DATA
from app.robot import RobotMeshError, UrdfError
from app.robot.description.mesh_locator import MeshLocator

NAME = "package://arm/meshes/a.stl"


@pytest.fixture
def place(tmp_path):
    """Makes ``tmp_path/PATH`` with a mesh file in it and returns it."""

    def make(path, content="x"):
        file = tmp_path / path
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(content)
        return file

    return make


@pytest.fixture
def urdf(place):
    return place("robots/urdf/robot.urdf")


def find(urdf, name=NAME, *dirs, **environment):
    return MeshLocator(urdf, dirs, environment).find(name)


def test_relative_names_start_at_the_urdf(urdf, place):
    mesh = place("robots/meshes/a.stl")
    assert find(urdf, "../meshes/a.stl").samefile(mesh)
    assert find(urdf, "a.stl") is None


def test_file_names_and_absolute_names(urdf, place):
    mesh = place("else where/a.stl")
    assert find(urdf, mesh.as_uri()) == mesh  # with %20
    assert find(urdf, str(mesh)) == mesh
    assert find(urdf, "file://localhost" + mesh.as_uri().removeprefix("file://")) == mesh
    with pytest.raises(RobotMeshError, match="another machine"):
        find(urdf, "file://server/a.stl")


@pytest.mark.parametrize("scheme", ["http", "https", "ftp", "model", "data"])
def test_other_schemes_are_refused(urdf, scheme):
    with pytest.raises(RobotMeshError, match=f"scheme '{scheme}'"):
        find(urdf, f"{scheme}://example.org/a.stl")


@pytest.mark.parametrize(
    "rest", ["../a.stl", "meshes/../../a.stl", "%2e%2e/a.stl", "/etc/passwd", "%2Fetc/passwd"]
)
def test_names_that_leave_their_package_are_refused(urdf, place, rest):
    place("robots/a.stl")
    with pytest.raises(RobotMeshError, match="leaves its package"):
        find(urdf, f"package://arm/{rest}")


def test_dots_that_stay_inside_are_fine(urdf, place):
    mesh = place("arm/meshes/a.stl")
    assert find(urdf, "package://arm/urdf/../meshes/a.stl", mesh.parents[1]) is None  # no urdf/
    (mesh.parents[1] / "urdf").mkdir()
    assert find(urdf, "package://arm/urdf/../meshes/a.stl", mesh.parents[1]).samefile(mesh)


def test_a_given_folder_may_be_the_package_by_name_by_manifest_or_hold_it(urdf, place, tmp_path):
    mesh = place("given/arm/meshes/a.stl")
    assert find(urdf, NAME, tmp_path / "given" / "arm") == mesh
    assert find(urdf, NAME, tmp_path / "given") == mesh
    other = place("checkout-1/meshes/a.stl")
    place("checkout-1/package.xml", "<package><name>arm</name></package>")
    assert find(urdf, NAME, tmp_path / "checkout-1") == other
    assert find(urdf, NAME, f"arm={tmp_path / 'checkout-1'}", tmp_path / "given") == other


def test_the_folder_that_carries_the_name_wins_over_one_that_only_fits(urdf, place, tmp_path):
    place("first/meshes/a.stl")
    named = place("second/arm/meshes/a.stl")
    assert find(urdf, NAME, tmp_path / "first", tmp_path / "second" / "arm") == named


def test_a_named_package_without_the_file_is_not_replaced_by_a_stranger(urdf, place, tmp_path):
    place("first/meshes/a.stl")
    (tmp_path / "second" / "arm").mkdir(parents=True)
    assert find(urdf, NAME, tmp_path / "first", tmp_path / "second" / "arm") is None


def test_a_folder_of_another_name_serves_when_none_carries_it(urdf, place, tmp_path):
    mesh = place("checkout-1/meshes/a.stl")
    assert find(urdf, NAME, tmp_path / "checkout-1") == mesh


def test_folders_above_the_urdf(urdf, place, tmp_path):
    below = place("robots/meshes/a.stl")
    assert find(urdf).samefile(below)  # by what is in it
    sibling = place("arm/meshes/a.stl")
    assert find(urdf).samefile(sibling)  # by name
    inside = place("arm/urdf/robot.urdf")
    assert find(inside).samefile(sibling)


def test_a_broken_manifest_above_the_urdf_does_no_harm(urdf, place):
    place("package.xml", "<package>")
    mesh = place("robots/meshes/a.stl")
    assert find(urdf).samefile(mesh)


def test_marginguard_is_the_projects_data(urdf):
    found = find(urdf, "package://marginguard/robots/touch/touch.urdf")
    assert found == PROJECT_DATA / "robots" / "touch" / "touch.urdf"


def test_the_ros_environment(urdf, place, tmp_path):
    installed = place("install/share/arm/meshes/a.stl")
    assert find(urdf, NAME, AMENT_PREFIX_PATH=f"/nowhere:{tmp_path / 'install'}") == installed
    assert find(urdf, NAME, ROS_PACKAGE_PATH=str(tmp_path / "install" / "share")) == installed
    assert find(urdf, NAME) is None


def test_given_folders_must_exist(urdf, tmp_path):
    with pytest.raises(UrdfError, match="not a folder"):
        MeshLocator(urdf, [tmp_path / "absent"])


@pytest.mark.parametrize("name", ["", "  "])
def test_an_empty_name_is_refused(urdf, name):
    with pytest.raises(RobotMeshError, match="empty"):
        find(urdf, name)


def test_a_name_that_no_file_can_have_is_not_found(urdf):
    assert find(urdf, "x" * 5000) is None
