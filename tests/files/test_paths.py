import hashlib
from pathlib import Path

import pytest

from app.files.paths import resolve_file, resolve_inside, sha256_of
from app.geometry import InputError


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    case = tmp_path / "case"
    (case / "sub").mkdir(parents=True)
    (case / "sub" / "mesh.stl").write_text("inside")
    (tmp_path / "secret.stl").write_text("outside")
    return case


def test_a_file_of_the_folder_is_found(folder: Path) -> None:
    assert resolve_inside(folder, "sub/mesh.stl", "k").read_text() == "inside"


@pytest.mark.parametrize(
    "name",
    [
        "../secret.stl",
        "sub/../../secret.stl",
        "sub/../sub/mesh.stl",
        "/etc/passwd",
        "",
        ".",
        "..",
        "~/x",
        "..\\secret.stl",
        "C:/x",
        "sub/mesh.stl\0",
    ],
)
def test_names_that_could_leave_are_refused(folder: Path, name: str) -> None:
    with pytest.raises(InputError, match=r"^tool\.mesh\.path is .*relative path"):
        resolve_inside(folder, name, "tool.mesh.path")


def test_an_absolute_name_is_refused_even_inside(folder: Path) -> None:
    with pytest.raises(InputError, match="expected a relative path"):
        resolve_inside(folder, str(folder / "sub" / "mesh.stl"), "k")


@pytest.mark.parametrize("link", ["file", "directory"])
def test_a_symbolic_link_may_not_leave(folder: Path, link: str) -> None:
    if link == "file":
        (folder / "link").symlink_to("../secret.stl")
        name = "link"
    else:
        (folder / "link").symlink_to(folder.parent)
        name = "link/secret.stl"
    with pytest.raises(InputError, match="symbolic link"):
        resolve_inside(folder, name, "k")


def test_a_loop_of_links_is_refused(folder: Path) -> None:
    (folder / "one").symlink_to("two")
    (folder / "two").symlink_to("one")
    with pytest.raises(InputError):
        resolve_inside(folder, "one", "k")


def test_the_case_itself_may_be_a_link(folder: Path, tmp_path: Path) -> None:
    (tmp_path / "other").symlink_to(folder)
    assert resolve_inside(tmp_path / "other", "sub/mesh.stl", "k").is_file()


def test_a_package_is_one_of_the_folders_or_lies_in_one(folder: Path, tmp_path: Path) -> None:
    package = tmp_path / "packages" / "arm"
    package.mkdir(parents=True)
    (package / "arm.urdf").write_text("x")
    for given in (package, package.parent):
        found = resolve_file(folder, "package://arm/arm.urdf", "k", package_dirs=[given])
        assert found == package / "arm.urdf"


@pytest.mark.parametrize(
    "name", ["package://arm/x", "package://marginguard/../secret", "package://", "package://../x"]
)
def test_a_package_that_is_not_there_or_is_left(folder: Path, name: str) -> None:
    with pytest.raises(InputError, match=r"^robot\.urdf is"):
        resolve_file(folder, name, "robot.urdf")


def test_a_folder_is_no_file(folder: Path) -> None:
    with pytest.raises(InputError, match="is not a file"):
        resolve_file(folder, "sub", "k")


def test_sha256(folder: Path) -> None:
    assert sha256_of(folder / "sub/mesh.stl") == hashlib.sha256(b"inside").hexdigest()
