"""Robot of a case by its keys: packages, absolute paths, xacro arguments, optional meshes."""

import pytest

from app.case import open_case
from app.geometry import InputError, MarginGuardError
from app.session import load_case_robot
from tests.case.conftest import add_robot, write_manifest

XACRO = """<robot name="arm" xmlns:xacro="http://www.ros.org/wiki/xacro">
<xacro:arg name="name" default="default"/><xacro:arg name="count" default="1"/>
<xacro:arg name="far" default="false"/>
<link name="$(arg name)$(arg count)$(arg far)"/></robot>
"""


@pytest.fixture
def package(tmp_path):
    """The folder of the package ``arm``, in the folder ``packages``."""
    folder = tmp_path / "packages" / "arm"
    folder.mkdir(parents=True)
    (folder / "arm.urdf").write_text("<robot/>")
    (folder / "arm.xacro").write_text(XACRO)
    return folder


def test_joints_are_on_the_trackers_clock(manifest, write_case, package):
    manifest["clock"] = {"offset_robot_to_tracker_ms": 4.0}
    add_robot(manifest, "package://arm/arm.urdf", joint_states="/joint_states")
    case = open_case(write_case(manifest, count=3), package_dirs=[package.parent])
    assert case.has_joints
    assert case.robot_urdf() == package / "arm.urdf"
    # Recorded at 15, 10, 5 and 0 ms before each frame, from 1 s on at 50 Hz.
    assert [[j.stamp.ns // 10**6 for j in f.joints] for f in case.frames()] == [
        [989, 994, 999],
        [1004, 1009, 1014, 1019],
        [1024, 1029, 1034, 1039, 1044],
    ]


def test_frames_need_an_estimated_clock_offset(manifest, write_case, package):
    manifest["clock"] = {"estimate": True}
    add_robot(manifest, "package://arm/arm.urdf", joint_states="/joint_states")
    with pytest.raises(InputError, match=r"clock\.estimate is true"):
        open_case(write_case(manifest), package_dirs=[package.parent]).frames()


def test_xacro_of_a_case_is_refused(manifest, write_case, package):
    robot = add_robot(manifest, "arm.xacro")
    folder = write_case(manifest)
    (folder / "arm.xacro").write_text("<robot/>")
    with pytest.raises(InputError, match=r"robot\.urdf is 'arm\.xacro': a xacro file is code"):
        open_case(folder).robot_urdf()
    robot["urdf"] = "package://arm/arm.xacro"
    case = open_case(write_manifest(folder, manifest), package_dirs=[package.parent])
    assert case.robot_urdf() == package / "arm.xacro"


@pytest.mark.parametrize("by", ["package", "absolute path"])
def test_case_names_its_packages_and_the_arguments_of_a_xacro(manifest, write_case, package, by):
    urdf = "package://arm/arm.xacro" if by == "package" else str(package / "arm.xacro")
    robot = add_robot(manifest, urdf, xacro_args={"name": "tip", "count": 2, "far": True})
    manifest["package_dirs"] = {"arm": str(package)}
    folder = write_case(manifest)
    case = open_case(folder)
    assert case.robot_urdf() == package / "arm.xacro"
    assert load_case_robot(case).root_link == "tip2true"
    robot["xacro_args"]["nmae"] = "x"
    case = open_case(write_manifest(folder, manifest))
    with pytest.raises(MarginGuardError, match=r"no xacro argument 'nmae'; expected .*name"):
        load_case_robot(case)


def test_xacro_in_the_case_folder_cannot_be_reached_by_its_own_package_dirs(manifest, write_case):
    robot = add_robot(manifest, "package://arm/arm.xacro")
    manifest["package_dirs"] = {"arm": "own"}
    folder = write_case(manifest)
    (folder / "own").mkdir()
    (folder / "own" / "arm.xacro").write_text(XACRO)
    with pytest.raises(InputError, match=r"package_dirs\.arm is 'own': it is in the case folder"):
        open_case(folder)
    robot["urdf"] = str(folder / "own" / "arm.xacro")
    del manifest["package_dirs"]
    with pytest.raises(InputError, match="a xacro file is code"):
        open_case(write_manifest(folder, manifest))


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"arm": 3}, r"package_dirs\.arm is 3; expected a text"),
        ({"a/b": "x"}, r"package_dirs has the name 'a/b'; expected the name of a package"),
        ({"arm": "../x"}, r"package_dirs\.arm is '../x'; expected a relative path"),
        ({"arm": "/nowhere"}, r"package_dirs\.arm is '/nowhere'; expected an existing folder"),
        (["/x"], r"package_dirs is \['/x'\]; expected a mapping"),
    ],
)
def test_malformed_package_dirs_are_refused(manifest, write_case, values, message):
    manifest["package_dirs"] = values
    with pytest.raises(InputError, match=message):
        open_case(write_case(manifest))


def test_xacro_arguments_of_another_file_are_refused(manifest, write_case):
    add_robot(manifest, "arm.urdf", xacro_args={"a": "1"})
    with pytest.raises(InputError, match=r"xacro_args are given, but arm\.urdf is not"):
        open_case(write_case(manifest))


def test_robot_without_its_collision_meshes_is_used_on_request(manifest, write_case):
    robot = add_robot(manifest, "arm.urdf")
    folder = write_case(manifest)
    (folder / "arm.urdf").write_text(
        '<robot name="a"><link name="tip"><collision><geometry><mesh filename="no.stl"/></geometry>'
        "</collision></link></robot>"
    )
    with pytest.raises(MarginGuardError, match=r"mesh 'no.stl' of link 'tip' not found"):
        load_case_robot(open_case(folder))
    robot["collision_meshes"] = "optional"
    case = open_case(write_manifest(folder, manifest))
    assert load_case_robot(case).links_without_collision == ("tip",)
    load_case_robot(case)
    assert [note for note in case.notes() if "no.stl" in note] == [
        "the robot: collision shapes of link 'tip' left out: collision mesh 'no.stl' of link 'tip' "
        "not found; add the folder of its package to package_dirs"
    ]
