"""Worlds of the tests: small bodies, and robots of other projects where their files are."""

from pathlib import Path

import numpy as np
import pytest
import trimesh

from app.geometry import SurfaceMesh, Transform
from app.robot import Robot, load_robot
from app.simulation import BodyEntry, RobotEntry, WorldDescription
from tests.robot.conftest import example_robots as example_robots

ROOT = Path(__file__).resolve().parents[2]
LUMPECTOMY = ROOT / "data" / "worlds" / "lumpectomy"
TOUCH = ROOT / "data" / "robots" / "touch" / "touch.urdf"
PARALLELOGRAMS = ROOT / "data" / "robots" / "parallelogram"


def placed(frame: str, *position_mm: float) -> Transform:
    return Transform("world", frame, np.eye(3), np.array(position_mm))


def box(name: str, *size_mm: float) -> SurfaceMesh:
    shape = trimesh.creation.box(size_mm)
    return SurfaceMesh(name, shape.vertices, shape.faces)


def flat_sheet() -> SurfaceMesh:
    corners = np.array([[0, 0, 0], [9, 0, 0], [0, 9, 0], [9, 9, 0]])
    return SurfaceMesh("flat", corners, [[0, 1, 2], [1, 3, 2]])


def free_box(name: str = "cube", *position_mm: float, mass_kg: float = 0.1) -> BodyEntry:
    pose = placed(name, *(position_mm or (0, 0, 0)))
    return BodyEntry(name, box(name, 20, 20, 20), pose, mass_kg)


def floor() -> BodyEntry:
    return BodyEntry("floor", box("floor", 400, 400, 20), placed("floor", 0, 0, -10), None)


def arm(robot: Robot, **options: object) -> RobotEntry:
    values: dict[str, object] = {"density_kg_m3": 1000.0, "max_effort": 50.0, **options}
    base = Transform("world", robot.root_link, np.eye(3), np.array([10.0, -20.0, 30.0]))
    return RobotEntry("arm", robot, base, {}, **values)  # type: ignore[arg-type]


def world_of(*robots: RobotEntry, bodies: tuple[BodyEntry, ...] = ()) -> WorldDescription:
    return WorldDescription("test", 7, robots=robots, bodies=bodies)


@pytest.fixture(scope="session")
def touch():
    return load_robot(TOUCH)
