"""The two wheels, installed in a new environment away from the checkout: `make test-wheel`.

Not part of `make test`, because it builds a wheel and installs 2 GB. The tests run in this
order: first without any extra, then with ROS and the scene, at last the wheel is uninstalled.
"""

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import urllib.parse
import urllib.request
from collections.abc import Iterator
from http.cookiejar import CookieJar
from pathlib import Path

import pytest

from tests import shipped_case
from tests.ros_domain import domain_id as domain_id
from tests.slicer_module.test_marginguard_command import OURS, SLICER_DOUBLE
from tools import install

pytestmark = pytest.mark.timeout(1200)  # a fixture builds and installs

CASE = "package://marginguard/recorded_case"
LIVE = "package://marginguard/live_example/live.yaml"
COPIED = ("PATH", "LANG", "LC_ALL", "SSL_CERT_FILE", "http_proxy", "https_proxy", "no_proxy")


class Installation:
    """A virtual environment, the home of a new user, and an empty folder to work in."""

    wheel: str  # path of the built wheel of MarginGuard

    def __init__(self, root: Path, project: Path) -> None:
        self.venv, self.home, self.folder = root / "venv", root / "home", root / "folder"
        self.dist, self.project = root / "dist", project
        self.home.mkdir()
        self.folder.mkdir()

    @property
    def environment(self) -> dict[str, str]:
        """Variables of a new user: no PYTHONPATH; pip's settings and its cache are kept."""
        kept = {name: os.environ[name] for name in COPIED if name in os.environ}
        kept |= {name: value for name, value in os.environ.items() if name.startswith("PIP_")}
        return kept | {
            "HOME": str(self.home),
            "PIP_CACHE_DIR": os.environ.get("PIP_CACHE_DIR", f"{Path.home()}/.cache/pip"),
            "PIP_CONSTRAINT": str(self.project / "constraints.txt"),
            "PIP_DISABLE_PIP_VERSION_CHECK": "1",
            "ROS_DOMAIN_ID": os.environ.get("ROS_DOMAIN_ID", "0"),
        }

    @property
    def packages(self) -> Path:
        """Folder of the installed packages."""
        return self.venv / "lib" / f"python{OURS}" / "site-packages"

    def run(self, program: str, *arguments: str) -> subprocess.CompletedProcess[str]:
        """Run a program of the environment in the folder."""
        return subprocess.run(
            [str(self.venv / "bin" / program), *arguments],
            cwd=self.folder,
            env=self.environment,
            capture_output=True,
            text=True,
            check=False,
        )

    def pip(self, *arguments: str) -> None:
        """Run pip; fails with its output."""
        done = self.run("python", "-m", "pip", "--quiet", *arguments)
        assert done.returncode == 0, done.stdout + done.stderr

    def copy_kernels(self) -> None:
        """Use the kernels that the checkout has compiled of the same sources.

        numba knows a source by its size and time.
        """
        sources = self.project / "app"
        for source in sources.rglob("*.py"):
            installed, times = self.packages / source.relative_to(self.project), source.stat()
            assert installed.read_bytes() == source.read_bytes()
            os.utime(installed, ns=(times.st_atime_ns, times.st_mtime_ns))
        for kernel in sources.rglob("__pycache__/*.nb[ci]"):
            folder = self.packages / kernel.parent.relative_to(self.project)
            folder.mkdir(exist_ok=True)
            shutil.copy(kernel, folder)

    def install(self, *wheels: str) -> None:
        """Install wheels and what they need by uv, in a seventh of pip's time."""
        run_with_uv("uv", "pip", "install", "--python", f"{self.venv}/bin/python", *wheels)

    def marginguard(self, *arguments: str, status: int = 0) -> subprocess.CompletedProcess[str]:
        """Run the command; fails if its exit status differs."""
        done = self.run("marginguard", *arguments)
        assert done.returncode == status, done.stdout + done.stderr
        return done


def run_with_uv(*words: str) -> None:
    """Run a module of this Python as `make environment` does; fails with its output."""
    done = install.run(*words, **install.uv_variables())
    assert done.returncode == 0, done.stdout


@pytest.fixture(scope="module")
def installed(
    project_root: Path, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Installation]:
    """The wheel of MarginGuard without extras."""
    root = tmp_path_factory.mktemp("wheel")
    made = Installation(root, project_root)
    copy = root / "copy"
    ignored = shutil.ignore_patterns(".venv", ".git", "build", "out", "__pycache__", "*.egg-info")
    shutil.copytree(project_root, copy, ignore=ignored)
    # A source distribution first and the wheel from it, each in an environment of its own.
    run_with_uv("build", "--installer=uv", "--outdir", str(made.dist), str(copy))
    shutil.rmtree(copy)
    (made.wheel,) = map(str, made.dist.glob("*.whl"))
    subprocess.run([sys.executable, "-m", "venv", str(made.venv)], check=True)
    # Modules are compiled when they are imported, which most never are.
    made.pip("install", "--no-compile", "--no-deps", made.wheel)
    made.install(made.wheel)
    made.pip("check")  # pip, too, finds what the wheel needs
    made.copy_kernels()
    yield made
    shutil.rmtree(root)


@pytest.fixture(scope="module")
def complete(installed: Installation) -> Installation:
    """The same installation with the extras, and the messages that `make test` has built: 2 GB."""
    installed.install(str(install.wheel("interfaces")), f"{installed.wheel}[ros,scene]")
    return installed


def test_missing_wheel_is_reported_in_one_line_and_logged_in_full(monkeypatch, tmp_path, capfd):
    monkeypatch.setattr(install, "LOG", tmp_path / "install.log")
    status = install.main(["--no-index", "no-such-wheel==1.2.3"])
    error = capfd.readouterr().err
    assert status != 0
    assert error.startswith("marginguard: no wheel of no-such-wheel==1.2.3")
    assert error.count("\n") == 1
    assert "you require no-such-wheel==1.2.3" in install.LOG.read_text()


def test_python_api_opens_the_shipped_case(installed):
    code = "import marginguard as mg; print(mg.__file__, mg.open_case(mg.example_case()).extent)"
    done = installed.run("python", "-c", code)
    assert done.stdout.startswith(str(installed.packages / "marginguard")), done.stderr
    assert f"frames={shipped_case.FRAMES}" in done.stdout


def test_replay_without_extras_names_the_scene_for_the_picture(installed):
    done = installed.marginguard("replay", CASE, "--no-ros", "--report", "plain")
    assert "run `pip install 'marginguard[scene]'`" in done.stderr
    assert (installed.folder / "plain" / "summary.json").is_file()


@pytest.mark.parametrize(
    ("arguments", "extra"),
    [
        (["replay", CASE], "ros"),
        (["live", "--config", LIVE], "ros"),
        (["record", "-o", "recorded"], "ros"),
        (["view", CASE], "scene"),
    ],
)
def test_command_without_its_extra_names_it(installed, arguments, extra):
    done = installed.marginguard(*arguments, status=2)
    assert done.stderr.count("\n") == 1
    assert f"`pip install 'marginguard[{extra}]'`" in done.stderr
    assert not (installed.folder / "recorded").exists()


def test_doctor_lists_what_the_extras_bring(installed):
    checks = json.loads(installed.marginguard("doctor", "--json", status=1).stdout)
    missing = {check["name"]: check["remedy"] for check in checks if not check["ok"]}
    assert {"rclpy imports", "ROS interfaces", "3D Slicer scene"} <= set(missing)
    assert not [remedy for remedy in missing.values() if re.search(r"\bmake\b|-e ", remedy)]


def test_replay_publishes_and_draws(complete):
    done = complete.marginguard("replay", CASE, "--report", "drawn")
    assert "ROS discovery" in done.stderr
    assert (complete.folder / "drawn" / "scene.png").read_bytes().startswith(b"\x89PNG")
    csv = [(complete.folder / name / "margin.csv").read_bytes() for name in ("plain", "drawn")]
    assert csv[0] == csv[1]


def test_doctor_finds_nothing_missing(complete):
    complete.marginguard("doctor")


def test_case_is_made_and_described(complete):
    complete.marginguard("make-case", "mine", "--seed", "3")
    found = json.loads(complete.marginguard("info", "mine", "--json").stdout)
    assert found["provenance"]["kind"] == "simulated"


def test_page_is_served(complete):
    server = subprocess.Popen(
        [str(complete.venv / "bin" / "marginguard"), "view", CASE],
        cwd=complete.folder,
        env=complete.environment,
        stdout=subprocess.PIPE,
        text=True,
    )
    assert server.stdout is not None
    try:
        url = server.stdout.readline().strip()
        cookies = urllib.request.HTTPCookieProcessor(CookieJar())
        client = urllib.request.build_opener(cookies)
        with client.open(url) as answer:
            assert b'data-app-name="trame"' in answer.read()
        web = complete.packages / "app" / "viewer" / "web"
        for name in ("main.js", "page.css"):
            with client.open(urllib.parse.urljoin(url, f"/marginguard/{name}")) as answer:
                assert answer.read() == (web / name).read_bytes()
        server.send_signal(signal.SIGINT)
        assert server.wait() == 130
    finally:
        server.kill()
        server.communicate()


def test_benchmark_runs_with_the_shipped_code(complete):
    done = complete.run("marginguard", "bench", "session", "--steps", "100")
    assert re.search(r"states\W+NEGATIVE", done.stdout), done.stderr
    (info,) = complete.packages.glob("marginguard-*.dist-info")
    assert (info / "top_level.txt").read_text().split() == ["app", "marginguard"]


def test_slicer_is_started_with_the_shipped_modules(complete):
    program = complete.home / "Slicer-test-double" / "Slicer"
    (program.parent / "bin").mkdir(parents=True)
    program.write_text(SLICER_DOUBLE)
    python = program.parent / "bin" / "PythonSlicer"
    python.write_text(f"#!/bin/sh\necho 'Python {OURS}.4'\n")
    for path in (program, python):
        path.chmod(0o755)
    done = complete.marginguard("slicer", "--slicer", str(program), "--print")
    modules = complete.packages / "app" / "share" / "slicer_module"
    folders = re.search(r"--additional-module-paths (\S+) (\S+)", done.stdout)
    assert folders is not None, done.stdout
    assert set(folders.groups()) == {str(modules / "MarginGuard"), str(modules / "ROS2")}
    assert (modules / "MarginGuard" / "MarginGuard.py").is_file()
    assert str(complete.project) not in done.stdout


def test_module_called_app_is_refused(complete):
    (complete.folder / "app.py").write_text("raise SystemExit('the code of the user was run')\n")
    complete.marginguard("--version")  # a program does not import from the current folder
    done = complete.run("python", "-m", "marginguard", "--version")
    assert (done.returncode, done.stderr.count("\n")) == (2, 1)
    assert str(complete.folder / "app.py") in done.stderr


def test_clean_and_uninstall_leave_nothing(complete):
    cache = complete.home / ".cache" / "marginguard"
    assert list(cache.glob("*.field"))
    complete.marginguard("doctor", "clean", "--yes")
    complete.pip("uninstall", "--yes", "marginguard", "marginguard-interfaces")
    left = {"app", "marginguard", "marginguard_msgs", "tf2_msgs"}
    assert not [name for name in left if (complete.packages / name).exists()]
    assert not cache.exists()
