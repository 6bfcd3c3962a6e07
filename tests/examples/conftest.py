"""Runs examples as a user does: in a process of their own, in another folder, with a new HOME."""

import os
import re
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tests.examples.cpp_rule import compiled
from tests.python_process import run_python

ROOT = Path(__file__).resolve().parents[2]
EXAMPLES = ROOT / "examples"
TIMEOUT_S = 240

NUMBER = r"([+-]?\d+\.\d+)"
"""A number with decimals, as a group."""

RunExample = Callable[..., str]


def numbers(pattern: str, text: str) -> np.ndarray:
    """The numbers (n, k) of all matches of ``pattern``, which has k groups."""
    found = re.findall(pattern, text)
    return np.array(found, dtype=float).reshape(len(found), -1)


@pytest.fixture(scope="session")
def environment(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """Variables of a new user; all examples share the cache of fields in its HOME."""
    kept = ("PATH", "LD_LIBRARY_PATH", "_ROS_WHEELS_BOOTSTRAP_COMPLETE")
    return {
        **{name: os.environ[name] for name in kept if name in os.environ},
        "HOME": str(tmp_path_factory.mktemp("home")),
        "PYTHONPATH": str(ROOT),
    }


@pytest.fixture(scope="session")
def run_example(environment: dict[str, str]) -> RunExample:
    """``run_example("own_case.py", "my_case", folder=tmp_path)`` returns what it prints."""

    def run(name: str, *arguments: str, folder: Path) -> str:
        done = run_python(
            EXAMPLES / name, *arguments, cwd=folder, env=environment, timeout=TIMEOUT_S
        )
        assert "Traceback" not in done.stderr
        return done.stdout

    return run


@pytest.fixture(scope="session")
def own_case(run_example: RunExample, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """Folder of the case that `own_case.py` writes, and what it prints."""
    folder = tmp_path_factory.mktemp("own")
    return folder / "my_case", run_example("own_case.py", folder=folder)


@pytest.fixture(scope="session")
def cpp_sources() -> Path:
    """Folder of the C++ rule of a controller."""
    if shutil.which("g++") is None:
        pytest.skip("g++ is not installed")
    return EXAMPLES / "cpp_controller"


@pytest.fixture(scope="session")
def cpp_driver(cpp_sources: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Program that decides on the events of its standard input."""
    return compiled(cpp_sources, tmp_path_factory.mktemp("rule") / "driver", "-O2")
