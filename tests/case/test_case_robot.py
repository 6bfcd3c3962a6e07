"""How a case names its robot: packages, absolute paths, xacro arguments, optional meshes."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from app.case import open_case
from app.geometry import InputError, MarginGuardError
from app.session import load_case_robot

Manifest = dict[str, Any]
WriteCase = Callable[..., Path]

XACRO = """<robot name="arm" xmlns:xacro="http://www.ros.org/wiki/xacro">
<xacro:arg name="name" default="default"/><xacro:arg name="count" default="1"/>
<xacro:arg name="far" default="false"/>
<link name="$(arg name)$(arg count)$(arg far)"/></robot>
"""


@pytest.mark.parametrize("by", ["package", "absolute path"])
def test_case_names_its_packages_and_the_arguments_of_a_xacro(
    manifest: Manifest, write_case: WriteCase, tmp_path: Path, by: str
) -> None:
    package = tmp_path / "elsewhere"
    package.mkdir()
    (package / "arm.xacro").write_text(XACRO)
    robot = {
        "urdf": "package://arm/arm.xacro" if by == "package" else str(package / "arm.xacro"),
        "base_frame": "base",
        "tool_link": "tip",
        "xacro_args": {"name": "tip", "count": 2, "far": True},
    }
    manifest |= {"robot": robot, "package_dirs": {"arm": str(package)}}
    manifest["registration"] = {"method": "given", "matrix": np.eye(4).ravel().tolist()}
    folder = write_case(manifest)
    case = open_case(folder)
    assert case.robot_urdf() == package / "arm.xacro"
    assert load_case_robot(case).root_link == "tip2true"
    robot["xacro_args"]["nmae"] = "x"
    (folder / "case.yaml").write_text(yaml.safe_dump(manifest))
    case = open_case(folder)
    with pytest.raises(MarginGuardError, match=r"no xacro argument 'nmae'; expected .*name"):
        load_case_robot(case)


def test_xacro_in_the_case_folder_cannot_be_reached_by_its_own_package_dirs(
    manifest: Manifest, write_case: WriteCase
) -> None:
    robot = {"urdf": "package://arm/arm.xacro", "base_frame": "base", "tool_link": "tip"}
    manifest |= {"robot": robot, "package_dirs": {"arm": "own"}}
    manifest["registration"] = {"method": "given", "matrix": np.eye(4).ravel().tolist()}
    folder = write_case(manifest)
    (folder / "own").mkdir()
    (folder / "own" / "arm.xacro").write_text(XACRO)
    with pytest.raises(InputError, match=r"package_dirs\.arm is 'own': it is in the case folder"):
        open_case(folder)
    robot["urdf"] = str(folder / "own" / "arm.xacro")
    del manifest["package_dirs"]
    (folder / "case.yaml").write_text(yaml.safe_dump(manifest))
    with pytest.raises(InputError, match="a xacro file is code"):
        open_case(folder)


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
def test_malformed_package_dirs_are_refused(
    manifest: Manifest, write_case: WriteCase, values: object, message: str
) -> None:
    manifest["package_dirs"] = values
    with pytest.raises(InputError, match=message):
        open_case(write_case(manifest))


def test_xacro_arguments_of_another_file_are_refused(
    manifest: Manifest, write_case: WriteCase
) -> None:
    manifest["robot"] = {
        "urdf": "arm.urdf",
        "base_frame": "base",
        "tool_link": "tip",
        "xacro_args": {"a": "1"},
    }
    manifest["registration"] = {"method": "given", "matrix": np.eye(4).ravel().tolist()}
    with pytest.raises(InputError, match=r"xacro_args are given, but arm\.urdf is not"):
        open_case(write_case(manifest))


def test_robot_without_its_collision_meshes_is_used_on_request(
    manifest: Manifest, write_case: WriteCase
) -> None:
    robot = {"urdf": "arm.urdf", "base_frame": "base", "tool_link": "tip"}
    manifest["robot"] = robot
    manifest["registration"] = {"method": "given", "matrix": np.eye(4).ravel().tolist()}
    folder = write_case(manifest)
    (folder / "arm.urdf").write_text(
        '<robot name="a"><link name="tip"><collision><geometry><mesh filename="no.stl"/></geometry>'
        "</collision></link></robot>"
    )
    with pytest.raises(MarginGuardError, match=r"mesh 'no.stl' of link 'tip' not found"):
        load_case_robot(open_case(folder))
    robot["collision_meshes"] = "optional"
    (folder / "case.yaml").write_text(yaml.safe_dump(manifest))
    case = open_case(folder)
    assert load_case_robot(case).links_without_collision == ("tip",)
    load_case_robot(case)
    assert [note for note in case.notes() if "no.stl" in note] == [
        "the robot: collision shapes of link 'tip' left out: collision mesh 'no.stl' of link 'tip' "
        "not found; add the folder of its package to package_dirs"
    ]
