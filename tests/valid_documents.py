"""Valid documents: those that are shipped, and others that together have every key."""

from pathlib import Path
from typing import Any

import numpy as np
import yaml

from app.case import DISPLAY_ITEMS, DOCUMENTS, ItemKind
from app.case.manifest.structures import as_schema_2

IDENTITY = [1.0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]
ROOT = Path(__file__).resolve().parents[1]
SHIPPED = {
    "data/recorded_case/case.yaml": "case",
    "data/live_example/live.yaml": "live",
    "data/worlds/lumpectomy/live.yaml": "live",
    "data/phantom_case/case.yaml": "case",
    "data/recorded_case/expected.yaml": "expected",
    "data/phantom_case/expected.yaml": "expected",
    "data/structures_case/case.yaml": "case-2",
    "data/structures_case/expected.yaml": "expected",
}
POINTS = {
    "registration": {
        "method": "paired_points",
        "fixed_mm": [[0.0, 0, 1]],
        "moving_mm": [[1.0, 2, 3]],
        "max_drift_mm": 1,
        "max_drift_deg": 2.0,
    }
}
GIVEN = {
    "registration": {
        "method": "given",
        "matrix": IDENTITY,
        "covariance": np.eye(6).ravel().tolist(),
        "degrees_of_freedom": 12,
    }
}
XACRO = {
    "package_dirs": {"arm_description": "/opt/arm", "tools": "meshes/tools"},
    "robot": {
        "urdf": "package://arm_description/arm.xacro",
        "base_frame": "base",
        "tool_link": "tool",
        "xacro_args": {"name": "arm", "safety": True, "length": 0.5, "joints": 6},
        "collision_meshes": "optional",
    },
}
"""A robot of a xacro file, with all its keys but the topic of the joints."""

CONTROL = {
    "operators": ["/console", "/room/marginguard_rearm"],
    "security": "required",
    "guidance": {
        "force_n": 2.0,
        "range_mm": 10,
        "rate_n_s": 20,
        "period_ms": 20,
        "delay_ms": 5,
        "damping_n_s_m": 5,
    },
    "limiter": {
        "tau_ms": 80.0,
        "lever_mm": 40,
        "retreat_mm_s": 10,
        "max_speed_mm_s": 100,
        "max_turn_rad_s": 1,
        "accept_simulated": True,
    },
    "tumor_motion": {
        "swing_mm": 5,
        "swing_deg": 1,
        "rate_hz": 0.25,
        "jitter_mm": 0.3,
        "jitter_deg": 0.3,
        "frame": "tracker",
    },
}
PLAUSIBILITY = {
    "plausibility": {
        "motion": {
            "max_speed_mm_s": 500.0,
            "max_acceleration_mm_s2": 8000,
            "max_speed_deg_s": 600,
            "max_acceleration_deg_s2": 5000.0,
        },
        "mean_drift_mm": 2.0,
        "pairs": [
            {
                "parent": "reference",
                "child": "needle",
                "max_mm": 12,
                "max_deg": 10.0,
                "pose": {"matrix": IDENTITY},
            },
            {"parent": "cautery", "child": "grip", "distance_mm": 80, "tolerance_mm": 2.0},
        ],
        "workspace": {"frame": "reference", "center_mm": [0.0, 0, 50], "radius_mm": 300},
        "approach": {
            "frame": "tracker",
            "direction": [0.0, 0, -1],
            "axis": [0, 0.0, 1],
            "max_deg": 70,
        },
    }
}
IMAGES = {
    "images": {
        "path": "probe.igs.mha",
        "probe": "probe",
        "calibration": "plus.xml",
        "orientation": "UF",
        "stale_after_ms": 200.0,
    }
}
TOPIC_IMAGES = {
    "images": {"topic": "/marginguard/image", "probe": "probe", "calibration": "plus.xml"}
}
DEPTHS = {
    "images": {
        "probe": "probe",
        "calibrations": [
            {"depth_mm": 40, "path": "plus.xml"},
            {"depth_mm": 55.5, "matrix": [0.1, 0, 0, 0, 0, 0.1, 0, 0, 0, 0, 0.1, 0, 0, 0, 0, 1]},
        ],
        "depth_mm": 40,
    }
}
LIVE_IMAGES = {
    "images": {
        "device": "Image",
        "probe": "probe",
        "calibration": "plus.xml",
        "orientation": "UF",
        "stale_after_ms": 200.0,
    }
}
_ROD = {
    "length_mm": 60,
    "tip_from": {"direction": [0.0, 0, -1]},
    "model": {"path": "rod.stl", "units": "mm"},
}
_POINTER = {
    "tip_from": {"matrix": [1.0, 0, 0, 2, 0, 1, 0, 3, 0, 0, 1, 120, 0, 0, 0, 1]},
    "sigma_mm": 0.3,
}
ITEMS = {
    each.name: {"frame": each.name, **(_ROD if each.kind is ItemKind.ROD else _POINTER)}
    for each in DISPLAY_ITEMS
}
CAUTERY = {"cautery": {"topic": "/generator/active", "stale_after_ms": 500.0}}
BOX = {
    "plausibility": {
        "workspace": {"frame": "robot_base", "min_mm": [0.0, 0, 0], "max_mm": [1, 2.0, 3]}
    }
}


def shipped(document: str) -> dict[str, Any]:
    """The first shipped document of that name, or the same values in schema 2."""
    if document == "live-2":
        return as_schema_2(shipped("live"))
    path = next(path for path, name in SHIPPED.items() if name == document)
    values: dict[str, Any] = yaml.safe_load((ROOT / path).read_text())
    return values


def shipped_structures() -> dict[str, Any]:
    """The expected results of a case with several structures."""
    values: dict[str, Any] = yaml.safe_load(
        (ROOT / "data/structures_case/expected.yaml").read_text()
    )
    return values


def complete(document: str) -> list[dict[str, Any]]:
    """Valid documents that together have every key."""
    if document == "expected":
        return [shipped(document), shipped_structures()]
    if document.endswith("-2"):
        of_1 = [as_schema_2(values) for values in complete(document.removesuffix("-2"))]
        values = shipped(document)
        (tool,) = values["tools"]
        two = [tool, {**tool, "name": "left", "frame": "left"}]
        return [values, values | {"tools": two, "tool_distance_mm": 5.0}, *of_1]
    values = shipped(document)
    optional = {"release_samples": 4, "release_band_mm": 1, "frozen_after_ms": 500.0}
    full = values | {"margins": values["margins"] | optional}
    tumor, known = values["tumor"], {"offset_robot_to_tracker_ms": 3, "estimate": False}
    contour = {
        "frame": tumor["frame"],
        "pose": tumor["pose"],
        "contour": {"path": "t.fcsv"},
        "sigma_mm": 0.5,
    }
    mesh: dict[str, Any] = {
        "tumor": tumor | {"mesh": {"path": "t.stl", "units": "cm", "repair": True}},
        "tool": values["tool"] | {"mesh": {"path": "tool.ply", "units": "mm", "repair": True}},
    }
    mesh["tool"]["sigma_mm"] = 0.2
    segment = {"tumor": tumor | {"mesh": {"path": "t.nrrd", "segment": "T"}}}
    if document == "live":
        igtl = {"igtl": {"host": "plus", "port": 18944}, "clock": "host"}
        tf = {"tf": {"edges": [{"parent": "tracker", "child": "needle"}]}, "clock": "estimate"}
        tf |= {"latency_ms": 20, "sigma_mm": 0.2, "sigma_deg": 0.1}
        return [
            values,
            full | CONTROL | mesh | {"source": tf} | PLAUSIBILITY,
            full
            | BOX
            | POINTS
            | segment
            | LIVE_IMAGES
            | {"source": igtl, "clock": known, "cautery": {"device": "Cautery"}},
            full | {"tumor": contour} | TOPIC_IMAGES | GIVEN | CAUTERY | ITEMS,
            full | XACRO | POINTS | {"images": {"topic": "/image", **DEPTHS["images"]}},
        ]
    return [
        values,
        full | PLAUSIBILITY | POINTS | segment | {"clock": {"estimate": True}},
        full | XACRO | POINTS | IMAGES | ITEMS,
        full | BOX | mesh | TOPIC_IMAGES | GIVEN | CAUTERY | {"clock": known},
        full
        | {
            "registration": {"method": "robot_world", "dwells": [{"start_s": 0, "end_s": 1}]},
            "tumor": contour,
            "recording": {"path": "t.igs.mha", "rate_hz": 20.0},
        }
        | DEPTHS,
    ]


VALID = [(document, values) for document in DOCUMENTS for values in complete(document)]
