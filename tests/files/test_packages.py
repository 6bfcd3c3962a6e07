"""Folders of the packages that ``package://`` names."""

from pathlib import Path

import pytest

from app.files.packages import PROJECT_DATA, PackageFolders, split_package_dir, split_package_name
from app.files.paths import resolve_file


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    """A folder of another name than its package, which is ``arm``."""
    folder = tmp_path / "checkout-1"
    folder.mkdir()
    (folder / "package.xml").write_text("<package><name>arm</name></package>")
    (folder / "arm.urdf").write_text("<robot/>")
    return folder


def test_given_folders_come_before_those_above_and_the_installed(
    checkout: Path, tmp_path: Path
) -> None:
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


def test_installed_packages_need_an_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(PROJECT_DATA.parent))
    assert list(PackageFolders().named("robots")) == []
    assert list(PackageFolders().named("marginguard")) == [PROJECT_DATA]


@pytest.mark.parametrize("name", ["", ".", ".."])
def test_name_that_is_no_package_has_no_folder(checkout: Path, name: str) -> None:
    assert list(PackageFolders([checkout], above=[checkout]).named(name)) == []


@pytest.mark.parametrize(
    "manifest", ["<package>", "<!DOCTYPE p><package><name>arm</name></package>"]
)
def test_broken_manifest_names_no_package(checkout: Path, manifest: str) -> None:
    (checkout / "package.xml").write_text(manifest)
    assert list(PackageFolders([checkout]).named("arm")) == []


def test_package_below_a_given_folder_is_found_by_its_manifest(
    checkout: Path, tmp_path: Path
) -> None:
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


def test_manifest_of_a_case_finds_packages_as_its_urdf_does(checkout: Path) -> None:
    for entry in (checkout, f"arm={checkout}"):
        found = resolve_file(checkout, "package://arm/arm.urdf", "robot.urdf", package_dirs=[entry])
        assert found == checkout / "arm.urdf"


def test_names_and_entries_are_split(tmp_path: Path) -> None:
    assert split_package_name("package://arm/meshes/a.stl") == ("arm", "meshes/a.stl")
    assert split_package_name("package://arm") == ("arm", "")
    assert split_package_dir("arm=/robots") == ("arm", Path("/robots"))
    (tmp_path / "a=b").mkdir()
    assert split_package_dir(tmp_path / "a=b") == (None, tmp_path / "a=b")
