"""The tiers: the fast one tests every pure package and its sub-packages; a named file runs."""

from pathlib import Path

import pytest

from tests.forking import run_forked
from tests.tiers import tier_of

pytestmark = pytest.mark.slow

PURE = ["geometry", "files", "registration", "robot", "fixture", "case", "session", "runtime"]
PURE += ["synthetic", "igtl", "report"]
"""Packages without ROS, VTK and a web server."""


@pytest.mark.parametrize("package", PURE)
def test_fast_tier_tests_every_pure_package_and_its_sub_packages(project_root, package):
    def has_fast_tests(folder: Path) -> bool:
        return any(tier_of(path) == "fast" for path in folder.rglob("test_*.py"))

    root = project_root / "tests" / package
    folders = [root, *(path for path in root.iterdir() if any(path.glob("test_*.py")))]
    assert [folder.name for folder in folders if not has_fast_tests(folder)] == []


@pytest.mark.parametrize(
    ("text", "tier"),
    [
        ("import pytest\n", "fast"),
        ("pytestmark = pytest.mark.timeout(9)\n", "fast"),
        ("# pytestmark = pytest.mark.long\n", "fast"),
        ("pytestmark = pytest.mark.slow\n", "slow"),
        ("import a\n\npytestmark = [pytest.mark.long, pytest.mark.timeout(900)]\n", "long"),
        ("pytestmark = pytest.mark.exhaustive\n", "exhaustive"),
    ],
)
def test_marker_of_a_file_is_its_tier(tmp_path, text, tier):
    path = tmp_path / "test_file.py"
    path.write_text(text)
    assert tier_of(path) == tier


def test_tier_selects_files_and_a_named_file_runs_in_any_tier(project_root):
    folder = "tests/registration/tool"
    files = {path.relative_to(project_root) for path in (project_root / folder).glob("test_*.py")}
    fast = {path.as_posix() for path in files if tier_of(project_root / path) == "fast"}
    named, *others = sorted({path.as_posix() for path in files} - fast)
    assert others, "expected a slow file that is left out"
    words = ("--collect-only", "-qq", "-p", "no:cacheprovider", "--tier", "fast", folder, named)
    done = run_forked("-m", "pytest", *words, folder=project_root)
    assert done.returncode == 0, done.stdout
    lines = (line for line in done.stdout.splitlines() if "::" in line or ": " in line)
    assert {line.partition(":")[0] for line in lines} == fast | {named}
