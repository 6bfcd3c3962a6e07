"""Plans in files, as ``marginguard plan`` writes them, without a search."""

import json
from pathlib import Path
from typing import Any

import numpy as np

from app.geometry import Transform
from app.planning.path_timing import time_path
from app.robot import Robot

LIMITS = np.array([[1.0], [5.0], [50.0]])
"""Velocity, acceleration and jerk."""
TURN_RAD = 0.6


def write_approach(path: Path, robot: Robot, setup_id: str, /, **changes: Any) -> Path:
    """The first joint turns by `TURN_RAD` from 0, the others stay; a ball is 30 to 20 mm away."""
    first, *others = robot.actuated_joint_names
    times_ns, positions, velocities = time_path(np.array([[0.0], [TURN_RAD]]), LIMITS)
    samples = np.unique(np.linspace(0, len(times_ns) - 1, 21).round().astype(int)).tolist()
    values = {
        "robot": robot.name,
        "joints": [first],
        "held": dict.fromkeys(others, 0.1),
        "limits": {first: {"velocity": 1.0, "acceleration": 5.0, "jerk": 50.0}},
        "clearance_mm": 5.0,
        "made_from": {"setup_id": setup_id} if setup_id else {},
        "reasons": [],
        "times_ns": times_ns.tolist(),
        "positions": positions.tolist(),
        "velocities": velocities.tolist(),
        "preview": {
            "samples": samples,
            "nearest": [["ball", each] for each in np.linspace(30.0, 20.0, len(samples))],
        },
    }
    path.write_text(json.dumps(values | changes))
    return path


def write_needle(
    path: Path, setup_id: str, frame_from_target: Transform, /, *ends_mm: Any, **changes: Any
) -> Path:
    """``ends_mm`` are the entry and the target of each corridor, in the frame of the pose."""
    values = {
        "setup_id": setup_id,
        "frame": frame_from_target.target,
        "target": frame_from_target.source,
        "frame_from_target": frame_from_target.matrix.tolist(),
        "window_mm": 1.0,
        "needle": {"length_mm": 120.0, "diameter_mm": 1.2, "bend_mm": 0.0, "sigma_mm": 1.0},
        "corridors": [{"entry_mm": entry, "target_mm": target} for entry, target in ends_mm],
    }
    path.write_text(json.dumps(values | changes))
    return path
