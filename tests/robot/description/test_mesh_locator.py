"""Resolution of mesh names, and refusal of names outside the allowed folders."""

import pytest

from app.robot import RobotMeshError, UrdfError
from app.robot.mesh_locator import MeshLocator

NAME = "package://arm/meshes/a.stl"


@pytest.fixture
def place(tmp_path):
    """Return a function that writes ``tmp_path/PATH`` and returns it."""

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


def test_relative_names_are_relative_to_the_urdf(urdf, place):
    mesh = place("robots/meshes/a.stl")
    assert find(urdf, "../meshes/a.stl").samefile(mesh)
    assert find(urdf, "a.stl") is None


def test_file_urls_and_absolute_names_are_found(urdf, place):
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
def test_name_that_leaves_its_package_is_refused(urdf, place, rest):
    place("robots/a.stl")
    with pytest.raises(RobotMeshError, match="leaves its package"):
        find(urdf, f"package://arm/{rest}")


def test_dots_inside_the_package_are_accepted(urdf, place):
    mesh = place("arm/meshes/a.stl")
    assert find(urdf, "package://arm/urdf/../meshes/a.stl", mesh.parents[1]) is None  # no urdf/
    (mesh.parents[1] / "urdf").mkdir()
    assert find(urdf, "package://arm/urdf/../meshes/a.stl", mesh.parents[1]).samefile(mesh)


def test_folder_with_the_package_name_precedes_other_folders(urdf, place, tmp_path):
    place("first/meshes/a.stl")
    named = place("second/arm/meshes/a.stl")
    assert find(urdf, NAME, tmp_path / "first", tmp_path / "second" / "arm") == named


def test_package_without_the_file_is_not_replaced_by_another_folder(urdf, place, tmp_path):
    mesh = place("first/meshes/a.stl")
    (tmp_path / "second" / "arm").mkdir(parents=True)
    assert find(urdf, NAME, tmp_path / "first", tmp_path / "second" / "arm") is None
    # A folder of another name is used when none has the name.
    assert find(urdf, NAME, tmp_path / "first") == mesh


def test_folders_above_the_urdf_are_searched(urdf, place, tmp_path):
    below = place("robots/meshes/a.stl")
    assert find(urdf).samefile(below)  # the folder has another name
    sibling = place("arm/meshes/a.stl")
    assert find(urdf).samefile(sibling)  # the folder has the package name
    inside = place("arm/urdf/robot.urdf")
    assert find(inside).samefile(sibling)


def test_installed_ros_packages_are_found(urdf, place, tmp_path):
    installed = place("install/share/arm/meshes/a.stl")
    assert find(urdf, NAME, AMENT_PREFIX_PATH=f"/nowhere:{tmp_path / 'install'}") == installed
    assert find(urdf, NAME, ROS_PACKAGE_PATH=str(tmp_path / "install" / "share")) == installed
    assert find(urdf, NAME) is None


def test_missing_folder_and_empty_name_are_refused_and_a_long_name_is_not_found(urdf, tmp_path):
    with pytest.raises(UrdfError, match="not a folder"):
        MeshLocator(urdf, [tmp_path / "absent"])
    for name in ("", "  "):
        with pytest.raises(RobotMeshError, match="empty"):
            find(urdf, name)
    assert find(urdf, "x" * 5000) is None
