"""Paths of files, inside of a folder and by the names of packages."""

import hashlib
from pathlib import Path

import pytest

from app.files.paths import (
    PROJECT_DATA,
    PackageFolders,
    input_path,
    resolve_file,
    resolve_inside,
    sha256_of,
    split_package_dir,
    split_package_name,
)
from app.geometry import InputError
from tests.refusals import refused


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    case = tmp_path / "case"
    (case / "sub").mkdir(parents=True)
    (case / "sub" / "mesh.stl").write_text("inside")
    (tmp_path / "secret.stl").write_text("outside")
    return case


def test_file_of_the_folder_is_found_also_through_a_link_to_the_folder(folder, tmp_path):
    assert resolve_inside(folder, "sub/mesh.stl", "k").read_text() == "inside"
    assert sha256_of(folder / "sub/mesh.stl") == hashlib.sha256(b"inside").hexdigest()
    (tmp_path / "other").symlink_to(folder)
    assert resolve_inside(tmp_path / "other", "sub/mesh.stl", "k").is_file()


def test_absolute_name_and_a_folder_are_refused(folder):
    with pytest.raises(InputError, match="expected a relative path"):
        resolve_inside(folder, str(folder / "sub" / "mesh.stl"), "k")
    with pytest.raises(InputError, match="is not a file"):
        resolve_file(folder, "sub", "k")


@pytest.mark.parametrize(
    "name",
    ["../secret.stl", "sub/../../secret.stl", "sub/../sub/mesh.stl", "/etc/passwd", "", ".", "..",
     "~/x", "..\\secret.stl", "C:/x", "sub/mesh.stl\0"],
)  # fmt: skip
def test_name_that_could_leave_the_folder_is_refused(folder, name):
    with pytest.raises(InputError, match=r"^tool\.mesh\.path is .*relative path"):
        resolve_inside(folder, name, "tool.mesh.path")


@pytest.mark.parametrize(
    ("target", "name", "problem"),
    [("../secret.stl", "link", "symbolic link"), ("..", "link/secret.stl", "symbolic link"),
     ("link", "link", "")],
    ids=["file", "directory", "loop"],
)  # fmt: skip
def test_symbolic_link_out_of_the_folder_is_refused(folder, target, name, problem):
    (folder / "link").symlink_to(target)
    with pytest.raises(InputError, match=problem or None):
        resolve_inside(folder, name, "k")


def test_package_is_a_given_folder_or_lies_in_one(folder, tmp_path):
    package = tmp_path / "packages" / "arm"
    package.mkdir(parents=True)
    (package / "arm.urdf").write_text("x")
    for given in (package, package.parent):
        found = resolve_file(folder, "package://arm/arm.urdf", "k", package_dirs=[given])
        assert found == package / "arm.urdf"


@pytest.mark.parametrize(
    "name", ["package://arm/x", "package://marginguard/../secret", "package://", "package://../x"]
)
def test_unknown_package_and_path_out_of_a_package_are_refused(folder, name):
    with pytest.raises(InputError, match=r"^robot\.urdf is"):
        resolve_file(folder, name, "robot.urdf")


def test_absolute_name_of_a_file_is_accepted_where_files_are_named(folder):
    path = folder / "sub" / "mesh.stl"
    assert resolve_file(folder.parent, str(path), "tool.mesh.path") == path
    with pytest.raises(InputError, match=r"^k is '/nowhere/x.stl': .* is not a file"):
        resolve_file(folder, "/nowhere/x.stl", "k")


def test_input_path_names_shipped_data_and_any_path():
    case = input_path("package://marginguard/recorded_case")
    assert case.is_absolute()
    assert (case / "case.yaml").is_file()
    assert input_path("package://marginguard") == case.parent
    assert input_path("../some/case") == Path("../some/case")


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("package://marginguard/no_case", "no such file in"),
        ("package://marginguard/../app", "relative path without"),
        ("package://other/recorded_case", "unknown package"),
    ],
)
def test_input_path_of_nothing_shipped_is_refused(name, message):
    with pytest.raises(InputError, match=message):
        input_path(name)


@pytest.mark.parametrize("name", ["<a></a>" * 100_000, "a" * 4097, "/" + "b/" * 3000])
def test_name_longer_than_a_path_may_be_is_refused(tmp_path, name):
    for resolve in (resolve_inside, resolve_file):
        with refused(r"^data file has \d+ characters; expected 4096 at most$"):
            resolve(tmp_path, name, "data file")


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    """A folder of another name than its package, which is ``arm``."""
    folder = tmp_path / "checkout-1"
    folder.mkdir()
    (folder / "package.xml").write_text("<package><name>arm</name></package>")
    (folder / "arm.urdf").write_text("<robot/>")
    return folder


def test_given_folders_come_before_those_above_and_the_installed(checkout, tmp_path):
    installed, above = tmp_path / "install" / "share" / "arm", tmp_path / "above" / "arm"
    installed.mkdir(parents=True)
    above.mkdir(parents=True)
    folders = PackageFolders(
        [checkout],
        above=[above.parent],
        environment={"AMENT_PREFIX_PATH": f"/nowhere:{tmp_path / 'install'}"},
    )
    assert list(folders.named("arm")) == [checkout, above, installed]
    assert list(folders.installed()) == [Path("/nowhere/share"), installed.parent]


def test_installed_packages_need_an_environment(monkeypatch):
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(PROJECT_DATA.parent))
    assert list(PackageFolders().named("robots")) == []
    assert list(PackageFolders().named("marginguard")) == [PROJECT_DATA]


@pytest.mark.parametrize("name", ["", ".", ".."])
def test_name_that_is_no_package_has_no_folder(checkout, name):
    assert list(PackageFolders([checkout], above=[checkout]).named(name)) == []


@pytest.mark.parametrize(
    "manifest", ["<package>", "<!DOCTYPE p><package><name>arm</name></package>"]
)
def test_broken_manifest_names_no_package(checkout, manifest):
    (checkout / "package.xml").write_text(manifest)
    assert list(PackageFolders([checkout]).named("arm")) == []


def test_package_below_a_given_folder_is_found_by_its_manifest(checkout, tmp_path):
    manifest = """<?xml version="1.0"?>
<?xml-model href="http://download.ros.org/schema/package_format3.xsd" schematypens="x"?>
<package format="3"><name>arm</name></package>"""
    (checkout / "package.xml").write_text(manifest)
    nested = tmp_path / "workspace" / "src" / "repository"
    nested.mkdir(parents=True)
    (nested / "package.xml").write_text(manifest)
    assert list(PackageFolders([tmp_path]).named("arm")) == [checkout]
    assert list(PackageFolders([tmp_path / "workspace"]).named("arm")) == [nested]
    assert list(PackageFolders([checkout]).named("arm")) == [checkout]
    assert list(PackageFolders([tmp_path]).named("other")) == []


def test_manifest_of_a_case_finds_packages_as_its_urdf_does(checkout):
    for entry in (checkout, f"arm={checkout}"):
        found = resolve_file(checkout, "package://arm/arm.urdf", "robot.urdf", package_dirs=[entry])
        assert found == checkout / "arm.urdf"


def test_names_and_entries_are_split(tmp_path):
    assert split_package_name("package://arm/meshes/a.stl") == ("arm", "meshes/a.stl")
    assert split_package_name("package://arm") == ("arm", "")
    assert split_package_dir("arm=/robots") == ("arm", Path("/robots"))
    (tmp_path / "a=b").mkdir()
    assert split_package_dir(tmp_path / "a=b") == (None, tmp_path / "a=b")
