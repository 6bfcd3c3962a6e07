"""Allowed imports between the packages of ``app/`` and between their sub-packages."""

import ast
import graphlib
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.forking import run_forked
from tests.import_statements import import_statements
from tests.python_process import run_python

pytestmark = pytest.mark.slow

APP = Path(__file__).resolve().parents[1] / "app"
SLICER_MODULES = APP.parent / "slicer_module"
API = APP.parent / "marginguard"

MAY_IMPORT = {
    "geometry": set(),
    "files": {"geometry"},
    "registration": {"geometry"},
    "robot": {"geometry", "files"},
    "case": {"geometry", "files"},
    "fixture": {"geometry"},
    "hold": {"geometry", "files", "fixture"},
    "session": {"geometry", "files", "registration", "robot", "case", "fixture", "hold"},
    "runtime": {"geometry", "files", "registration", "robot", "case", "fixture", "hold", "session"},
    "workflow": {
        "geometry",
        "files",
        "registration",
        "robot",
        "fixture",
        "contour",
        "session",
        "runtime",
        "control",
        "planning",
    },
    "synthetic": {"geometry", "files", "case", "robot", "fixture"},
    "control": {"geometry", "files", "robot", "fixture"},
    "planning": {"geometry", "robot", "fixture"},
    "contour": {"geometry", "case", "fixture"},
    "cohort": {"geometry", "files", "synthetic"},
    "dicom": {"geometry"},
    "simulation": {"geometry", "files", "synthetic", "robot", "fixture"},
    "igtl": {"geometry"},
    "bridge": {
        "geometry",
        "files",
        "registration",
        "robot",
        "case",
        "fixture",
        "hold",
        "session",
        "runtime",
        "igtl",
        "control",
        "planning",
        "workflow",
        "simulation",
    },
    "analysis": {"geometry", "registration", "fixture", "session"},
    "scene": {"geometry", "files", "robot", "fixture", "session", "runtime"},
    "report": {
        "cohort",
        "geometry",
        "files",
        "registration",
        "case",
        "fixture",
        "session",
        "runtime",
        "analysis",
        "planning",
    },
    "viewer": {
        "geometry",
        "files",
        "registration",
        "robot",
        "case",
        "contour",
        "fixture",
        "hold",
        "session",
        "runtime",
        "workflow",
        "scene",
    },
}
ALL_PACKAGES = set(MAY_IMPORT)
SUB_PACKAGES_MAY_IMPORT = {
    "bridge": {
        "convert": set(),
        "calls": {"convert"},
        "control": {"calls"},
        "publishing": set(),
        "displays": {"calls", "control"},
        "live": {"calls", "control", "displays", "publishing"},
    },
    "case": {
        "tumor": set(),
        "messages": set(),
        "readers": {"messages"},
        "images": {"messages", "readers"},
        "manifest": {"tumor"},
    },
    "fixture": {
        "surfaces": set(),
        "meshes": {"surfaces"},
        "proximity": {"surfaces", "meshes"},
        "control": {"proximity"},
    },
    "viewer": {"drawing": set(), "messages": set()},
}
"""Package -> sub-package -> sub-packages that it may import."""

ONLY_IN = {
    "rclpy": {"bridge"},
    "control_msgs": {"bridge"},
    "tf2_msgs": {"bridge"},
    "marginguard_msgs": {"bridge"},
    "slicer": {"scene", "viewer"},
    "vtk": {"scene", "viewer"},
    "vtkmodules": {"scene", "viewer"},
    "trame": {"viewer"},
    "trame_rca": {"viewer"},
    "trame_vtk": {"viewer"},
    "trame_server": {"viewer"},
    "wslink": {"viewer"},
    "aiohttp": {"viewer"},
    "msgpack": {"viewer"},
    "trame_slicer": {"scene", "viewer"},
    "fcl": {"fixture"},
    "mujoco": {"simulation"},
    "coacd": {"simulation"},
    "ompl": {"planning"},
    "ruckig": {"planning"},
    "yourdfpy": {"robot"},
    "rosbags": {"case"},
    "dask": set(),
    "distributed": set(),
    "fsspec": {"cohort"},
    "highdicom": {"dicom"},
    "pydicom": {"dicom"},
    "statsmodels": {"cohort"},
    "matplotlib": {"report"},
    "jinja2": {"report"},
    "PIL": {"scene"},
}
"""External module -> packages that may import it (`cli` may import all of them)."""


def imports(path: Path) -> Iterator[str]:
    for node in import_statements(path):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        else:
            module = "." * node.level + (node.module or "")
            yield module
            if module == "app":
                yield from (f"app.{alias.name}" for alias in node.names)


def package_of(path: Path) -> str:
    return path.relative_to(APP).parts[0]


FILES = sorted(path for path in APP.rglob("*.py") if path.parent != APP)


def test_every_listed_package_has_files():
    assert {package_of(path) for path in FILES} >= set(MAY_IMPORT) | {"cli"}


@pytest.mark.parametrize("package", sorted({package_of(path) for path in FILES}))
def test_packages_import_only_allowed_packages(package):
    allowed = MAY_IMPORT.get(package, ALL_PACKAGES | {"cli"}) | {package}
    for path in (path for path in FILES if package_of(path) == package):
        for name in imports(path):
            assert not name.startswith("."), f"{path}: relative import of {name}"
            head, *rest = name.split(".")
            if head == "app" and rest and (APP / rest[0]).is_dir():
                assert rest[0] in allowed, f"{path}: {package} may not import {name}"
            if head in ONLY_IN and package != "cli":
                allowed_in = sorted(ONLY_IN[head])
                assert package in allowed_in, f"{path} imports {name}; only {allowed_in} may"
            if package == "geometry" and head != "app":
                known = sys.stdlib_module_names | {"numpy", "scipy", "lazy_loader"}
                assert head in known, f"{path}: geometry imports {name}"


@pytest.mark.parametrize(
    ("package", "folder"),
    [
        (package, folder)
        for package, folders in SUB_PACKAGES_MAY_IMPORT.items()
        for folder in folders
    ],
)
def test_sub_packages_import_only_allowed_sub_packages(package, folder):
    allowed = SUB_PACKAGES_MAY_IMPORT[package]
    files = sorted((APP / package / folder).rglob("*.py"))
    assert len(files) > 1
    modules = {tuple(name.split(".")) for path in files for name in imports(path)}
    imported = {m[2] for m in modules if m[:2] == ("app", package) and len(m) > 2}
    assert imported & allowed.keys() <= allowed[folder] | {folder}


def imported_modules(path: Path) -> Iterator[str]:
    """Dotted names that ``path`` imports; of ``from a import b`` both ``a`` and ``a.b``."""
    for node in import_statements(path):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif node.module:
            yield node.module
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


PACKAGES = sorted({parent for path in FILES for parent in path.parents if APP in parent.parents})


@pytest.mark.parametrize("package", PACKAGES, ids=lambda path: str(path.relative_to(APP)))
def test_sub_packages_form_no_cycle(package):
    """The graph is computed from the imports: a new sub-package needs no entry."""
    prefix = (APP.name, *package.relative_to(APP).parts)
    folders = {path.name for path in package.iterdir() if path.is_dir() and any(path.glob("*.py"))}
    graph = {}
    for folder in folders:
        names = {
            name
            for path in (package / folder).rglob("*.py")
            for module in imported_modules(path)
            for parts in [tuple(module.split("."))]
            if parts[: len(prefix)] == prefix
            for name in parts[len(prefix) : len(prefix) + 1]
        }
        graph[folder] = (names & folders) - {folder}
    try:
        graphlib.TopologicalSorter(graph).prepare()
    except graphlib.CycleError as error:
        pytest.fail(
            f"sub-packages of {'.'.join(prefix)} form a cycle: {' -> '.join(error.args[1])}"
        )


def test_slicer_modules_do_not_import_the_command_line():
    imported = {name for path in SLICER_MODULES.rglob("*.py") for name in imports(path)}
    assert "app.bridge.displays" in imported
    assert not [name for name in imported if name.split(".")[:2] == ["app", "cli"]]


def test_public_api_imports_no_command_line_no_page_and_no_ros_or_vtk():
    files = [path for path in API.rglob("*.py") if path.name != "__main__.py"]  # the command
    names = {name for path in files for name in imports(path)}
    packages = {name.split(".")[1] for name in names if name.startswith("app.")}
    assert packages.isdisjoint({"cli", "viewer"})
    assert names.isdisjoint(set(ONLY_IN) - {"matplotlib"})
    # matplotlib gives the type of a figure only.
    code = "import marginguard as mg; mg.plot_margin, mg.read_constraint, mg.save_scene"
    assert loaded(code, {"matplotlib", "pandas", "rclpy", "slicer", "vtkmodules"}) == set()


def test_import_of_the_public_api_loads_no_library():
    code = "import marginguard as mg; assert mg.__version__ and 'replay' in dir(mg)"
    libraries = {"numpy", "scipy", "app.geometry", "app.cli"}
    assert loaded(code, libraries, warm=False) == set()


def test_app_does_not_import_the_public_api():
    assert [path for path in FILES if "marginguard" in set(imports(path))] == []


def test_exactly_one_file_imports_fcl():
    assert len([path for path in FILES if "fcl" in set(imports(path))]) == 1


def loaded(code: str, watched: set[str], *, warm: bool = True) -> set[str]:
    """Modules among ``watched`` that a process has loaded after running ``code``.

    A warm process has imported other libraries before, which saves most of the time.
    """
    check = f"import sys; assert {watched!r}.isdisjoint(sys.modules)"
    program = f"{check}\n{code}\nprint(*sys.modules)"
    if warm:
        done = run_forked("-c", program, folder=APP.parent)
    else:
        done = run_python("-c", program, status=None, cwd=APP.parent)
    assert done.returncode == 0, done.stderr
    return watched & set(done.stdout.split())


def import_all(*packages: str) -> str:
    return "\n".join(f"from app.{package} import *" for package in packages)


def test_session_loads_neither_ros_nor_vtk():
    code = import_all("session", "case", "robot", "fixture", "registration")
    heavy = {"rclpy", "vtk", "vtkmodules", "slicer", "matplotlib"}
    assert loaded(code, heavy | {"app.fixture.proximity.engine"}) == {
        "app.fixture.proximity.engine"
    }


def test_plans_of_displays_load_no_planner():
    code = "from app.workflow import ApproachGhost, NeedleGuide"
    assert loaded(code, {"ompl", "ruckig", "app.planning.approach"}) == set()


def test_slow_modules_are_loaded_only_when_used():
    code = f"import app.cli.main\n{import_all('session', 'report')}"
    slow = {"matplotlib", "scipy.stats", "rich", "slicer"}
    assert loaded(code, slow | {"app.session.live_session"}) == {"app.session.live_session"}


def test_package_loads_only_the_modules_of_the_imported_names():
    code = "from app.fixture import FixtureDecision; from app.robot import Robot; import app.report"
    slow = {"numba", "trimesh", "scipy.spatial", "app.fixture.control.decision"}
    assert loaded(code, slow, warm=False) == {"app.fixture.control.decision"}


def test_yourdfpy_is_loaded_only_with_a_urdf():
    assert loaded("from app.robot.urdf import parse_urdf", {"yourdfpy"}) == set()
    code = "from app.robot import load_robot; load_robot('data/robots/touch/touch.urdf')"
    assert loaded(code, {"yourdfpy", "jsonschema"}) == {"yourdfpy"}
