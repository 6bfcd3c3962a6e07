"""Each check of the machine fails without the checked part."""

import pytest

from app.cli import system_checks
from tests.python_process import run_python


@pytest.mark.parametrize(
    ("version", "ok"), [((3, 10), False), ((3, 11), True), ((3, 13), True), ((3, 14), False)]
)
def test_python_versions(version, ok):
    check = system_checks.check_python(version)
    assert check.ok is ok
    assert ("3.11 to 3.13" in check.remedy) is not ok


def test_platform_without_wheels_is_refused():
    assert system_checks.check_platform("Linux", "x86_64").ok
    assert "Linux on x86_64" in system_checks.check_platform("Linux", "aarch64").remedy
    assert not system_checks.check_platform("Darwin", "x86_64").ok


def no_library(name):
    raise OSError(f"{name}: cannot open shared object file")


@pytest.mark.parametrize(
    ("place", "double", "check", "remedy"),
    [
        ("sysconfig.get_path", lambda name: "/none", "check_headers", "/none/Python.h"),
        ("importlib.util.find_spec", lambda name: None, "check_venv", "python3-venv"),
        ("ctypes.CDLL", no_library, "check_egl", "libegl1"),
    ],
)
def test_missing_part_is_named(monkeypatch, place, double, check, remedy):
    monkeypatch.setattr(f"app.cli.system_checks.{place}", double)
    found = getattr(system_checks, check)()
    assert not found.ok
    assert remedy in found.remedy


def test_missing_compiler_is_named(monkeypatch):
    monkeypatch.setenv("CXX", "no-such-compiler -O2")
    check = system_checks.check_compiler()
    assert not check.ok
    assert check.remedy.startswith("no-such-compiler not found")
    assert "g++" in check.remedy


def run_alone(**environment):
    """The file as `make` runs it: by itself, without this project on the path."""
    return run_python("-I", system_checks.__file__, status=None, env=environment, timeout=60)


def test_file_run_alone_prints_one_sentence_and_fails(tmp_path):
    done = run_alone(PATH=str(tmp_path), CC="cc", CXX="c++")
    (line,) = [line for line in done.stderr.splitlines() if "compile" in line]
    assert done.returncode == 1
    assert line.startswith("marginguard: cc and c++ not found")


def test_file_run_alone_finds_egl_without_drivers(tmp_path):
    """Mesa's library without its drivers: VTK would crash, so loading the library is not enough."""
    if not system_checks.check_egl().ok:
        pytest.skip("no EGL on this system_checks, so none to take the drivers from")
    done = run_alone(PATH="/usr/bin:/bin", LIBGL_DRIVERS_PATH=str(tmp_path))
    assert done.returncode == 1
    assert done.stderr == (
        "marginguard: pictures cannot be rendered without a screen: "
        "apt install libegl1 libgl1-mesa-dri\n"
    )
