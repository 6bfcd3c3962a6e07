"""The wheel has every file of the packages and of the shipped folders, and works where it lies.

Part of `make test-wheel`. `installed_wheel` installs it; these tests only build and read it.
"""

import json
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

from tests.python_process import run_python

PACKAGES = {"app", "marginguard"}
SHIPPED = {"benchmarks", "data", "examples", "foxglove", "launch", "rviz", "slicer_module"}

PROGRAM = """
import json, app
from app.case import open_case
from app.files.paths import input_path
from app.files.paths import checkout, shipped

print(json.dumps({
    "app": app.__file__,
    "checkout": checkout(),
    "shipped": str(shipped("rviz", "margin.rviz")),
    "case": open_case(input_path("package://marginguard/recorded_case")).manifest.name,
}))
"""


@pytest.fixture(scope="module")
def sources(project_root: Path) -> list[Path]:
    """Files of the project, without those that git ignores."""
    if not (project_root / ".git").exists() or shutil.which("git") is None:
        pytest.skip("not a git checkout: its files cannot be listed")
    listed = subprocess.run(
        ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"],
        cwd=project_root,
        capture_output=True,
        text=True,
        check=True,
    )
    paths = map(Path, listed.stdout.rstrip("\0").split("\0"))
    return [path for path in paths if (project_root / path).is_file()]


@pytest.fixture(scope="module")
def wheel(
    project_root: Path, sources: list[Path], tmp_path_factory: pytest.TempPathFactory
) -> zipfile.ZipFile:
    """The wheel of a copy of the project: setuptools writes into the folder that it builds."""
    copy, dist = tmp_path_factory.mktemp("copy"), tmp_path_factory.mktemp("dist")
    for path in sources:
        (copy / path.parent).mkdir(parents=True, exist_ok=True)
        shutil.copy(project_root / path, copy / path)
    stale = copy / "build" / "lib" / "app" / "removed.py"  # as an earlier build leaves it
    stale.parent.mkdir(parents=True)
    stale.write_text("")
    command = ["pip", "wheel", "--no-build-isolation", "--no-deps", "--quiet", "-w", str(dist)]
    subprocess.run([sys.executable, "-m", *command, str(copy)], check=True)
    (built,) = dist.iterdir()
    return zipfile.ZipFile(built)


def test_wheel_has_exactly_the_packages_and_the_shipped_files(wheel, sources):
    expected = {path.as_posix() for path in sources if path.parts[0] in PACKAGES}
    expected |= {f"app/share/{path.as_posix()}" for path in sources if path.parts[0] in SHIPPED}
    found = {name for name in wheel.namelist() if ".dist-info/" not in name}
    assert found == expected


def test_unpacked_wheel_finds_its_own_files(wheel, tmp_path):
    site, elsewhere = tmp_path / "site", tmp_path / "elsewhere"
    elsewhere.mkdir()
    wheel.extractall(site)
    environment = {"PYTHONPATH": str(site), "PATH": "/usr/bin:/bin", "HOME": str(elsewhere)}
    done = run_python("-P", "-c", PROGRAM, cwd=elsewhere, env=environment)
    assert json.loads(done.stdout) == {
        "app": str(site / "app" / "__init__.py"),
        "checkout": None,
        "shipped": str(site / "app" / "share" / "rviz" / "margin.rviz"),
        "case": "simulated lumpectomy 1",
    }
    assert list(elsewhere.iterdir()) == []


def test_doctor_names_a_damaged_file_of_an_installed_wheel(wheel, tmp_path):
    wheel.extractall(tmp_path)
    page = tmp_path / "app" / "viewer" / "web" / "page.html"
    page.write_text(page.read_text()[:100])
    program = "import json\nfrom app.cli.installation_checks import check_shipped\n"
    program += "print(json.dumps([check for check in check_shipped() if not check.ok]))"
    done = run_python("-P", "-c", program, env={"PYTHONPATH": str(tmp_path)})
    ((name, _, found, remedy),) = json.loads(done.stdout)
    assert name == "installed files"
    assert str(page) in found
    assert remedy.startswith("install it again: `pip install")
