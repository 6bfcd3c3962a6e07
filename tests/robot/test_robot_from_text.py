"""Untrusted descriptions: which files they may read, and limits of their size."""

import shutil

import pytest

from app.robot import RobotMeshError, UrdfError, robot_from_text


def text_with(mesh):
    return (
        '<robot name="r"><link name="a"><collision><geometry>'
        f'<mesh filename="{mesh}"/></geometry></collision></link></robot>'
    )


@pytest.fixture
def mesh(tmp_path):
    """A mesh in a folder of its own."""
    import trimesh

    folder = tmp_path / "models"
    folder.mkdir()
    trimesh.creation.box((1, 1, 1)).export(folder / "box.stl")
    return folder / "box.stl"


@pytest.mark.parametrize("scheme", ["file://", ""])
def test_only_allowed_folders_are_read(mesh, scheme):
    text = text_with(f"{scheme}{mesh}")
    with pytest.raises(RobotMeshError, match="outside the allowed mesh folders"):
        robot_from_text(text)
    assert len(robot_from_text(text, allowed_dirs=[mesh.parent]).links[0].collisions) == 1
    assert len(robot_from_text(text, package_dirs=[mesh.parent]).links[0].collisions) == 1


def test_packages_are_found_and_links_out_of_them_are_refused(mesh, tmp_path):
    package = tmp_path / "packages" / "arm"
    package.mkdir(parents=True)
    shutil.copy(mesh, package / "own.stl")
    (package / "link.stl").symlink_to(mesh)
    folders = [tmp_path / "packages"]
    assert robot_from_text(text_with("package://arm/own.stl"), package_dirs=folders).links
    with pytest.raises(RobotMeshError, match="outside the allowed"):
        robot_from_text(text_with("package://arm/link.stl"), package_dirs=folders)
    with pytest.raises(RobotMeshError, match="leaves its package"):
        robot_from_text(text_with("package://arm/../../models/box.stl"), package_dirs=folders)
    with pytest.raises(RobotMeshError, match="has no package name"):
        robot_from_text(text_with("package://../models/box.stl"), package_dirs=folders)


def test_working_directory_is_not_searched(mesh, monkeypatch):
    monkeypatch.chdir(mesh.parent)
    with pytest.raises(RobotMeshError, match="not found"):
        robot_from_text(text_with("box.stl"))


def test_relative_names_are_resolved_in_the_allowed_folders(touch_urdf, touch, mesh):
    robot = robot_from_text(touch_urdf.read_text(), allowed_dirs=[touch_urdf.parent])
    assert [len(link.visuals) for link in robot.links] == [len(x.visuals) for x in touch.links]
    assert robot.warnings == ()
    (mesh.parent.parent / "other").mkdir()
    with pytest.raises(RobotMeshError, match="outside the allowed"):
        robot_from_text(text_with("../models/box.stl"), allowed_dirs=[mesh.parent.parent / "other"])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("x" * 10_000_000, "10000000 characters; expected at most 8388608 bytes"),
        ("é" * 5_000_000, "10000000 bytes; expected at most 8388608"),
        ('<!DOCTYPE r [<!ENTITY a SYSTEM "file:///etc/passwd">]><robot>&a;</robot>', "DOCTYPE"),
        ("", "robot_description is not well-formed: "),
        ("bodies: []", "not well-formed"),
        ("<robot name='\ud800'/>", "cannot be encoded as UTF-8"),
    ],
)
def test_malformed_text_is_refused_in_one_short_line(text, message):
    with pytest.raises(UrdfError, match=message) as refused:
        robot_from_text(text)
    assert len(str(refused.value)) < 300
    assert "\n" not in str(refused.value)
