"""Another module called ``app`` is refused with one line, by the package and by the command."""

import os
import subprocess
from pathlib import Path

import pytest

from tests.python_process import run_python


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A user's folder, whose ``app.py`` must not run."""
    (tmp_path / "app.py").write_text("raise SystemExit('the code of the user was run')\n")
    return tmp_path


def run(
    project_root: Path, folder: Path, *arguments: str, path: str = ""
) -> subprocess.CompletedProcess[str]:
    """Run Python in ``folder`` with the project, after ``path``, on its path."""
    environment = {**os.environ, "PYTHONPATH": f"{path}{os.pathsep}{project_root}".strip(":")}
    environment.pop("PYTHONSAFEPATH", None)
    return run_python(*arguments, status=None, cwd=folder, env=environment)


def test_command_names_the_other_module_in_one_line(project_root, folder):
    done = run(project_root, folder, "-m", "marginguard", "doctor")
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith(f"marginguard: error: the module 'app' is {folder / 'app.py'}; ")
    assert done.stderr.count("\n") == 1


def test_package_raises_import_error(project_root, folder):
    code = "import marginguard as mg\ntry: mg.open_case\nexcept ImportError as e: print(e, e.name)"
    done = run(project_root, folder, "-c", code)
    assert done.stdout.startswith(f"the module 'app' is {folder / 'app.py'}; expected ")
    assert done.stdout.endswith(" app\n")


def test_module_that_is_already_imported_is_named(project_root, folder):
    (folder / "app.py").write_text("import marginguard\nprint(marginguard.__version__)\n")
    done = run(project_root, folder, "-c", "import app")
    assert f"ImportError: the module 'app' is {folder / 'app.py'}; " in done.stderr


def test_safe_path_ignores_the_current_folder(project_root, folder):
    done = run(project_root, folder, "-P", "-m", "marginguard", "--version")
    assert done.stdout.startswith("marginguard ")
    done = run(project_root, folder, "-P", "-m", "marginguard", "--version", path=str(folder))
    assert "rename the other one, or take its folder off Python's path" in done.stderr
