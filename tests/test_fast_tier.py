"""The fast tier: the table of slow tests is valid, and every pure package has fast tests."""

from pathlib import Path

import pytest

from tests.conftest import EARLY, LONG, SLOW, is_slow

PURE = ["geometry", "files", "registration", "robot", "fixture", "case", "session", "runtime"]
PURE += ["synthetic", "igtl", "report"]
"""Packages without ROS, VTK and a web server."""


LISTED = [path for table in (SLOW, LONG) for paths in table.values() for path in paths]


@pytest.mark.parametrize("path", [*EARLY, *LISTED])
def test_listed_path_exists(project_root: Path, path: str) -> None:
    listed = project_root / path
    assert listed.is_dir() if path.endswith("/") else listed.is_file()


@pytest.mark.parametrize("package", PURE)
def test_fast_tier_tests_every_pure_package_and_its_sub_packages(
    project_root: Path, package: str
) -> None:
    def has_fast_tests(folder: Path) -> bool:
        files = (path.relative_to(project_root) for path in folder.rglob("test_*.py"))
        return not all(is_slow(path.as_posix()) for path in files)

    root = project_root / "tests" / package
    folders = [root, *(path for path in root.iterdir() if any(path.glob("test_*.py")))]
    assert [folder.name for folder in folders if not has_fast_tests(folder)] == []
