"""Fixtures: small robots written at run time, the touch arm, and known robots."""

import importlib.metadata
from pathlib import Path

import numpy as np
import pytest

from app.robot import load_robot


@pytest.fixture
def write_urdf(tmp_path):
    """Return a function that writes ``<robot>BODY</robot>`` and returns the path."""

    def write(body: str, *, folder: Path = tmp_path, name: str = "robot.urdf") -> Path:
        folder.mkdir(parents=True, exist_ok=True)
        path = folder / name
        path.write_text(f'<?xml version="1.0"?>\n<robot name="test">\n{body}\n</robot>\n')
        return path

    return write


@pytest.fixture(scope="session")
def touch_urdf(project_root):
    return project_root / "data" / "robots" / "touch" / "touch.urdf"


@pytest.fixture(scope="session")
def touch(touch_urdf):
    return load_robot(touch_urdf)


@pytest.fixture
def rng():
    return np.random.default_rng(20240611)


@pytest.fixture(scope="session")
def example_robots():
    """The folder of robots in the example-robot-data wheel."""
    try:
        files = importlib.metadata.files("example-robot-data") or []
    except importlib.metadata.PackageNotFoundError:
        pytest.skip("the example-robot-data wheel is not installed")
    folders = [Path(str(f.locate())).parents[2] for f in files if f.name == "ur5_robot.urdf"]
    if not folders:
        pytest.skip("the example-robot-data wheel holds no ur5_robot.urdf")
    return folders[0]


@pytest.fixture(scope="session")
def panda_urdf(example_robots):
    return example_robots / "panda_description" / "urdf" / "panda.urdf"


@pytest.fixture(scope="session")
def panda(panda_urdf):
    """A robot of 7 revolute and 2 prismatic joints; one of these is a mimic joint of the other."""
    return load_robot(panda_urdf)
