"""Writes the folder of a simulated operation: ``live.yaml`` with its files, and the truth."""

from pathlib import Path
from typing import Any

import numpy as np
import yaml

from app.case.new_case import matrix_values, placed_mesh, write_live_manifest
from app.files.atomic_io import new_folder
from app.geometry import SurfaceMesh
from app.synthetic.operation import (
    PROBE,
    SUPPOSED_RADIUS_MM,
    OperationTruth,
    probe_from_image,
)
from app.synthetic.tumour_and_tool import (
    BASE_FRAME,
    TOOL_FILE,
    TOOL_LINK,
    TUMOR_FRAME,
    TUMOR_SENSOR,
    icosphere,
    tool_mesh,
    write_stl,
)

IMAGE_TOPIC = "/ultrasound/image"
CONFIG_NAME, TRUTH_FOLDER = "live.yaml", "truth"
_STALE_MS = 1000
_ROD_MM = 14.0
"""The sensor is in the middle of the tumour, the tip beyond it."""


def write_operation(folder: Path, truth: OperationTruth) -> None:
    """Write ``live.yaml`` and what it names, and ``truth/``: the true tumour and calibrations.

    Raises `InputError` if ``folder`` exists or cannot be written; nothing is left then.
    """
    directions, faces = icosphere(3)
    ball = SurfaceMesh(TUMOR_FRAME, directions * SUPPOSED_RADIUS_MM, faces.astype(np.int32))
    with new_folder(folder) as partial:
        write_stl(partial / TOOL_FILE, tool_mesh())
        write_stl(partial / "ball.stl", ball)
        numbers = (" ".join(map(repr, row)) for row in probe_from_image().tolist())
        (partial / "image_to_probe.txt").write_text("\n".join(numbers), encoding="utf-8")
        write_live_manifest(partial / CONFIG_NAME, _live(truth))
        true_folder = partial / TRUTH_FOLDER
        true_folder.mkdir()
        write_stl(true_folder / "tumor.stl", truth.tumour.mesh(4))
        values = {
            "tool_from_tip": matrix_values(truth.tool_from_tip),
            "reference_from_base": matrix_values(truth.reference_from_base),
            f"{TUMOR_SENSOR}_from_tumor": matrix_values(truth.sensor_from_tumor),
            f"reference_from_{TUMOR_SENSOR}": matrix_values(truth.reference_from_sensor),
        }
        (true_folder / "truth.yaml").write_text(
            yaml.safe_dump(values, sort_keys=False), encoding="utf-8"
        )


def _live(truth: OperationTruth) -> dict[str, Any]:
    return {
        "schema": 1,
        "name": "simulated operation",
        "provenance": {
            "kind": "simulated",
            "source": "app.synthetic of this project; no patient",
            "licence": "Apache-2.0",
        },
        "source": {"tracked_transforms": {}, "clock": "host"},
        "images": {
            "topic": IMAGE_TOPIC,
            "probe": PROBE,
            "calibration": "image_to_probe.txt",
            "orientation": "MF",
            "stale_after_ms": _STALE_MS,
        },
        "tool": placed_mesh(TOOL_FILE, truth.supposed_tool_from_tip, "tip_from"),
        "tumor": placed_mesh("ball.stl", truth.sensor_from_tumor),
        "needle": {"frame": TUMOR_SENSOR, "length_mm": _ROD_MM},
        "robot": {
            "urdf": "package://marginguard/robots/touch/touch.urdf",
            "base_frame": BASE_FRAME,
            "tool_link": TOOL_LINK,
            "joint_states": "/joint_states",
        },
        "registration": {
            "method": "given",
            **matrix_values(truth.supposed_reference_from_base),
            "max_drift_mm": 8.0,
        },
        "margins": {
            "stop_mm": 1.0,
            "warn_mm": 5.0,
            "k_tre": 2.0,
            "v_max_mm_s": 2.0,
            "stale_after_ms": _STALE_MS,
        },
    }
