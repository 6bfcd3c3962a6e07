"""Imported distributions are declared in pyproject.toml and pinned in constraints.txt."""

import ast
import re
import sys
import tomllib
from functools import cache
from importlib import metadata
from pathlib import Path

import pytest

from tests.import_statements import import_statements

pytestmark = pytest.mark.slow

ROOT = Path(__file__).resolve().parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
BUILD = tomllib.loads((ROOT / "interfaces" / "pyproject.toml").read_text())["build-system"]

BROUGHT_BY = {
    "slicer": "trame-slicer",
    "slicer_core": "trame-slicer",
    "vtk": "trame-slicer",
    "vtkmodules": "trame-slicer",
    "trame_rca": "trame-slicer",
    "trame_server": "trame-slicer",
    "wslink": "trame-slicer",
    "aiohttp": "trame-slicer",
    "msgpack": "trame-slicer",
    "mpl_toolkits": "matplotlib",
    "rclpy": "ros-rclpy",
    "coal": "coal",  # its wheel does not name the module
    "pinocchio": "pin",  # its wheel does not name the module
    "dask": "distributed",  # pins the matching version
    "av": "av",  # optional
    "ruckig": "ruckig",  # nor does this one
    "manifold3d": "manifold3d",  # its wheel does not name the module
}
"""Module -> declared distribution that installs it in the matching version."""
OUR_FOLDERS = {path.name for path in ROOT.iterdir() if path.is_dir()}
# Slicer imports the file of a scripted module, and the package beside it, from its folder.
OUR_FOLDERS |= {path.stem for path in (ROOT / "slicer_module").glob("*/*")}
ROS_MESSAGES = re.compile(r"\w+_(msgs|srvs|interfaces)")


def normalized(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()


def names(requirements: list[str]) -> set[str]:
    """Normalized distribution names of ``requirements``."""
    return {
        normalized(re.split(r"[^A-Za-z0-9._-]", requirement)[0]) for requirement in requirements
    }


CORE = names(PROJECT["dependencies"])
EXTRAS = {extra: names(listed) for extra, listed in PROJECT["optional-dependencies"].items()}


def with_extras(*extras: str) -> set[str]:
    """The distributions of the core and of ``extras``."""
    return CORE.union(*(EXTRAS[extra] for extra in extras))


KNOWN = sys.stdlib_module_names | OUR_FOLDERS
IMPORTING = re.compile(r"^\s*(?:import\s+([\w., ]+)|from\s+(\w[\w.]*)\s+import\b)", re.M)
"""The start of a statement, or of a line of a text that looks like one."""


def imported(folder: str) -> dict[str, Path]:
    """External top-level modules, each with the first file that imports it."""
    found: dict[str, Path] = {}
    for path in sorted((ROOT / folder).rglob("*.py")):
        listed = (of or each for each, of in IMPORTING.findall(path.read_text()))
        names = {name.split()[0] for names in listed for name in names.split(",") if name.strip()}
        # Parsed only if it looks as if it imports a module that none has imported before.
        if {name.split(".")[0] for name in names} - KNOWN <= found.keys():
            continue
        for node in import_statements(path):
            if isinstance(node, ast.Import):
                modules = [alias.name for alias in node.names]
            else:
                modules = [node.module or ""] if node.level == 0 else []
            for module in modules:
                top = module.split(".")[0]
                beside = path.with_name(f"{top}.py")  # imported by a script that runs in its folder
                if top not in KNOWN and not beside.exists():
                    found.setdefault(top, path)
    return found


distributions = cache(metadata.packages_distributions)


@pytest.mark.parametrize(
    ("folder", "declared"),
    [
        (
            "app",
            with_extras(
                *("ros", "scene", "hdf5", "dicom", "simulation", "cohort", "volume", "video"),
                "planning",
            ),
        ),
        ("marginguard", CORE | EXTRAS["notebook"]),
        ("examples", CORE | EXTRAS["ros"]),
        ("tests", with_extras("ros", "scene", "dicom", "simulation", "cohort", "planning", "test")),
    ],
)
def test_every_import_is_declared(folder, declared):
    undeclared = []
    for module, path in imported(folder).items():
        if ROS_MESSAGES.fullmatch(module):
            continue
        brought = [BROUGHT_BY[module]] if module in BROUGHT_BY else distributions().get(module, [])
        if not declared & {normalized(name) for name in brought}:
            undeclared.append(f"{path.relative_to(ROOT)} imports {module}, of {brought or 'none'}")
    assert not undeclared


def test_every_requirement_is_pinned_once():
    lines = [
        line
        for line in (ROOT / "constraints.txt").read_text().splitlines()
        if line and not line.startswith("#")
    ]
    assert all(re.fullmatch(r"[a-z0-9-]+==[\w.+!-]+", line) for line in lines)
    pinned = [line.split("==")[0] for line in lines]
    assert len(pinned) == len(set(pinned))
    assert CORE.union(names(BUILD["requires"]), *EXTRAS.values()) <= set(pinned)
