"""A live session with images: a ball on a needle, a rod beside it, and a probe."""

from pathlib import Path
from typing import Any

import numpy as np
import trimesh
import yaml

TOPIC = "/ultrasound/image"
COLUMNS, ROWS = 640, 480
PIXEL_MM = 0.1
POSE_NS, POSES_OF_IMAGE = round(1e9 / 60), 2  # 60 poses and 30 images per second
PROBE_FROM_IMAGE = np.array(
    [[PIXEL_MM, 0, 0, -32], [0, PIXEL_MM, 0, -24], [0, 0, PIXEL_MM, 0], [0, 0, 0, 1]]
)
"""The centre of the ball is at column 320, row 240."""

POSES_MM = {
    "reference": (0.0, 0.0, 0.0),
    "needle": (0.0, 0.0, 0.0),
    "rod": (14.0, 0.0, -30.0),
    "probe": (0.0, 0.0, 0.0),
}
"""Place of each sensor in the tracker's frame; all have its axes."""


def image_stamp_ns(begin_ns: int, number: int) -> int:
    """Stamp of image ``number`` of a sender that has begun at ``begin_ns``."""
    return begin_ns + number * POSES_OF_IMAGE * POSE_NS - POSE_NS // 3


def write_session(folder: Path, **images: Any) -> Path:
    """Write ``live.yaml`` with its files to ``folder``; ``images`` are changes of that section."""
    folder.mkdir(parents=True, exist_ok=True)
    trimesh.creation.icosphere(subdivisions=3, radius=8.0).export(folder / "tumor.stl")
    rod = trimesh.creation.cylinder(radius=1.5, height=60.0, sections=24)
    rod.apply_translation([0.0, 0.0, 30.0])
    rod.export(folder / "rod.stl")
    numbers = " ".join(f"{value:g}" for value in PROBE_FROM_IMAGE.ravel())
    (folder / "image_to_probe.txt").write_text(numbers)
    identity = np.eye(4).ravel().tolist()

    def mesh(name: str) -> dict[str, str]:
        return {"path": f"{name}.stl", "units": "mm"}

    values = {
        "schema": 1,
        "name": "images",
        "provenance": {"kind": "simulated", "source": "made up", "licence": "none"},
        "source": {"tracked_transforms": {}, "clock": "host"},
        "images": {
            "topic": TOPIC,
            "probe": "probe",
            **({} if "calibrations" in images else {"calibration": "image_to_probe.txt"}),
            "stale_after_ms": 500,
            **images,
        },
        "tool": {"frame": "rod", "mesh": mesh("rod"), "tip_from": {"matrix": identity}},
        "tumor": {"frame": "needle", "mesh": mesh("tumor"), "pose": {"matrix": identity}},
        "margins": {
            "stop_mm": 1.0, "warn_mm": 5.0, "k_tre": 2.0, "v_max_mm_s": 50, "stale_after_ms": 500,
        },
    }  # fmt: skip
    path = folder / "live.yaml"
    path.write_text(yaml.safe_dump(values, sort_keys=False))
    return path
