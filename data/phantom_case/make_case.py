"""Writes the files of the phantom case beside the recording: meshes and YAML files.

Run from the project's root: ``python data/phantom_case/make_case.py``. The truth of
``expected.yaml`` is computed here from the text of the recording, by NumPy alone.
"""

import hashlib
import re
from itertools import pairwise
from pathlib import Path

import numpy as np
import trimesh
import yaml
from scipy.spatial.transform import Rotation

FOLDER = Path(__file__).resolve().parent
RECORDING = FOLDER / "tracking.igs.mha"
RADIUS_MM = 10.0

STYLUS_TIP_TO_STYLUS = np.array(
    [
        [0.997175, -0.0713837, -0.0233796, 108.565],
        [0.0714032, 0.997448, 0.0, 7.77385],
        [0.0233199, -0.00166938, 0.999727, 2.5389],
        [0.0, 0.0, 0.0, 1.0],
    ]
)
"""Calibration in the configuration of the recording. Its +x points out of the tip."""

PHANTOM_TO_REFERENCE = np.array(
    [
        [-0.00479115, 0.00329566, -0.999983, 22.7064],
        [-0.0127965, 0.999912, 0.00335674, -39.7536],
        [0.999907, 0.0128124, -0.00474856, 25.6504],
        [0.0, 0.0, 0.0, 1.0],
    ]
)
"""The published result of the phantom's registration."""

LANDMARK_MM = np.array([104.3, 5.0, 20.0])
"""Landmark #1 of the phantom."""

ROLL_DEG = 32.0
BASE_MM = np.array([142.0, -65.0, -46.0])
BASE_ROTATION = np.array([0.081, -1.472, -2.166])
"""Where the desktop arm would stand: all poses but a few are in its reach. Chosen, not measured."""

OUTLINE_MM = ((0.0, 0.0), (0.6, -1.0), (1.5, -8.0), (1.5, -60.0), (5.0, -68.0), (5.0, -140.0))
"""Radius and height of the stylus along its axis; the tip is at 0."""


def pose(rotation: np.ndarray, position_mm: np.ndarray) -> np.ndarray:
    """The (4, 4) matrix of a rotation and a position."""
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rotation, position_mm
    return matrix


def stylus_from_tip() -> np.ndarray:
    """The tip with +z forward, rolled about its axis so that the wrist of the arm is in range."""
    forward = np.column_stack([[0.0, 0, -1], [0, 1, 0], [1, 0, 0]])
    roll = Rotation.from_euler("z", ROLL_DEG, degrees=True).as_matrix()
    return STYLUS_TIP_TO_STYLUS @ pose(forward @ roll, np.zeros(3))


def reference_from_tumor() -> np.ndarray:
    """The sphere at the landmark."""
    return PHANTOM_TO_REFERENCE @ pose(np.eye(3), LANDMARK_MM)


def stylus_mesh() -> trimesh.Trimesh:
    """A cone, a shaft and a handle as one closed surface."""
    outline = [*OUTLINE_MM, (0.0, OUTLINE_MM[-1][1])]
    return trimesh.creation.revolve(outline[::-1], sections=32)


def recorded(name: str) -> np.ndarray:
    """Matrices (n, 4, 4) of ``<name>ToTracker`` in the text of the recording."""
    text = RECORDING.read_text("latin-1")
    rows = re.findall(rf"_{name}ToTrackerTransform = ([^\r\n]*)", text)
    return np.array([[float(number) for number in row.split()] for row in rows]).reshape(-1, 4, 4)


def recorded_times_s() -> np.ndarray:
    """Times (n,) in s from the first frame."""
    times = re.findall(r"_Timestamp = ([^\r\n]*)", RECORDING.read_text("latin-1"))
    return np.array([float(time) for time in times]) - float(times[0])


def distances_mm() -> np.ndarray:
    """Distance (n,) of the stylus to the sphere in each frame, negative inside.

    The stylus is a solid of revolution: in the plane through its axis and the sphere's centre, its
    surface is the outline, a polyline.
    """
    tips = np.linalg.inv(recorded("Reference")) @ recorded("Stylus") @ stylus_from_tip()
    center = np.append(reference_from_tumor()[:3, 3], 1.0)
    in_tip = (np.linalg.inv(tips) @ center)[:, :3]
    points = np.column_stack([np.linalg.norm(in_tip[:, :2], axis=1), in_tip[:, 2]])
    outline = np.array([*OUTLINE_MM, (0.0, OUTLINE_MM[-1][1])])
    nearest = np.full(len(points), np.inf)
    for start, end in pairwise(outline):
        along = np.clip((points - start) @ (end - start) / np.sum((end - start) ** 2), 0.0, 1.0)
        closest = start + along[:, None] * (end - start)
        nearest = np.minimum(nearest, np.linalg.norm(points - closest, axis=1))
    return nearest - RADIUS_MM


def breaches() -> list[dict[str, float | bool]]:
    """Intervals with a negative distance."""
    distances, times = distances_mm(), recorded_times_s()
    inside = np.concatenate([[False], distances < 0.0, [False]]).astype(int)
    edges = np.flatnonzero(np.diff(inside))
    return [
        {
            "start_s": round(float(times[first]), 4),
            "end_s": round(float(times[last - 1]), 4),
            "min_signed_distance_mm": round(float(distances[first:last].min()), 3),
            "shaft_only": False,
        }
        for first, last in zip(edges[::2], edges[1::2], strict=True)
    ]


def numbers(matrix: np.ndarray) -> list[float]:
    """16 numbers, row by row."""
    return [round(float(value), 9) for value in matrix.ravel()]


def main() -> None:
    """Write the files."""
    stylus_mesh().export(FOLDER / "stylus.stl")
    trimesh.creation.icosphere(subdivisions=4, radius=RADIUS_MM).export(FOLDER / "sphere.stl")
    base = pose(Rotation.from_rotvec(BASE_ROTATION).as_matrix(), BASE_MM)
    manifest = {
        "schema": 1,
        "name": "eight landmarks of a phantom",
        "provenance": {
            "kind": "recorded",
            "source": "PlusLibData, EightLandmarkPointsTrackedForPhantomRegistration; "
            "the sphere and the robot's base are added",
            "licence": "BSD-3-Clause (LICENSE)",
        },
        "recording": {
            "path": RECORDING.name,
            "sha256": hashlib.sha256(RECORDING.read_bytes()).hexdigest(),
        },
        "tool": {
            "frame": "stylus",
            "mesh": {"path": "stylus.stl", "units": "mm"},
            "tip_from": {"matrix": numbers(stylus_from_tip())},
        },
        "tumor": {
            "frame": "reference",
            "mesh": {"path": "sphere.stl", "units": "mm"},
            "pose": {"matrix": numbers(reference_from_tumor())},
        },
        "robot": {
            "urdf": "package://marginguard/robots/touch/touch.urdf",
            "base_frame": "robot_base",
            "tool_link": "stylus",
        },
        "registration": {"method": "given", "matrix": numbers(base)},
        "margins": {
            "stop_mm": 1.0,
            "warn_mm": 5.0,
            "k_tre": 2.0,
            "v_max_mm_s": 50.0,
            "stale_after_ms": 200,
        },
        "expected": "expected.yaml",
    }
    expected = {
        "frames": len(recorded_times_s()),
        "breaches": {
            "tolerance_ms": 1.0,
            "depth_tolerance_mm": 0.1,
            "intervals": breaches(),
        },
    }
    for name, values in (("case.yaml", manifest), ("expected.yaml", expected)):
        text = yaml.safe_dump(values, sort_keys=False, default_flow_style=None, width=100)
        (FOLDER / name).write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
