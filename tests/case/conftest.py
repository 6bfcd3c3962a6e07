"""Small recordings and cases, written by the tests themselves."""

import copy
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
import yaml

from app.case import JointSample, TrackingFrame, write_recording
from app.geometry import Stamp, TrackedTransform, TrackingStatus, Transform

IDENTITY = [1.0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]

MANIFEST: dict[str, Any] = {
    "schema": 1,
    "name": "a case",
    "provenance": {"kind": "simulated", "source": "a test", "licence": "Apache-2.0"},
    "recording": {"path": "tracking.mcap"},
    "tool": {
        "frame": "cautery",
        "mesh": {"path": "tool.stl", "units": "mm"},
        "tip_from": {"matrix": IDENTITY},
    },
    "tumor": {
        "frame": "needle",
        "mesh": {"path": "tumor.stl", "units": "mm"},
        "pose": {"matrix": IDENTITY},
    },
    "margins": {
        "stop_mm": 1.0,
        "warn_mm": 5.0,
        "k_tre": 2.0,
        "v_max_mm_s": 50,
        "stale_after_ms": 200,
    },
}


def some_frames(count: int = 50, *, seed: int = 0) -> Iterator[TrackingFrame]:
    """Frames at 50 Hz from 1 s on, three edges each, every seventh needle lost, joints between."""
    random = np.random.default_rng(seed)
    for index in range(count):
        stamp = Stamp(1_000_000_000 + index * 20_000_000)
        poses = []
        for source in ("reference", "needle", "cautery"):
            pose = Transform.from_rotation_vector(
                random.normal(size=3),
                random.normal(scale=200.0, size=3),
                target="tracker",
                source=source,
            )
            lost = source == "needle" and index % 7 == 3
            poses.append(
                TrackedTransform.lost("tracker", source, stamp, TrackingStatus.INVALID)
                if lost
                else TrackedTransform(pose, stamp, TrackingStatus.OK)
            )
        joints = tuple(
            JointSample(
                ("waist", "shoulder"), random.normal(size=2), stamp.shifted(shift, "tracker")
            )
            for shift in (-15_000_000, -10_000_000, -5_000_000, 0)
        )
        yield TrackingFrame(stamp, tuple(poses), joints, stamp.shifted(3_000_000, "tracker"))


def assert_same_frames(one: TrackingFrame, other: TrackingFrame, *, atol_mm: float = 1e-9) -> None:
    assert one.stamp == other.stamp
    assert one.unfiltered_stamp == other.unfiltered_stamp
    assert [(p.target, p.source, p.status, p.stamp) for p in one.poses] == [
        (p.target, p.source, p.status, p.stamp) for p in other.poses
    ]
    for mine, theirs in zip(one.poses, other.poses, strict=True):
        if mine.transform is not None and theirs.transform is not None:
            np.testing.assert_allclose(
                mine.transform.translation_mm,
                theirs.transform.translation_mm,
                rtol=0,
                atol=atol_mm,
            )
            np.testing.assert_allclose(
                mine.transform.rotation, theirs.transform.rotation, rtol=0, atol=1e-12
            )
    assert [(j.names, j.stamp) for j in one.joints] == [(j.names, j.stamp) for j in other.joints]
    for left, right in zip(one.joints, other.joints, strict=True):
        np.testing.assert_array_equal(left.positions, right.positions)


@pytest.fixture
def frames() -> Callable[..., Iterator[TrackingFrame]]:
    return some_frames


@pytest.fixture
def same_frames() -> Callable[..., None]:
    return assert_same_frames


@pytest.fixture
def manifest() -> dict[str, Any]:
    return copy.deepcopy(MANIFEST)


@pytest.fixture
def write_case(tmp_path: Path) -> Callable[..., Path]:
    """Write a case: the manifest given, two meshes, an MCAP recording of ``count`` frames."""

    def write(manifest: dict[str, Any], *, count: int = 50, name: str = "case") -> Path:
        folder = tmp_path / name
        folder.mkdir()
        trimesh.creation.icosphere(subdivisions=1, radius=10.0).export(folder / "tumor.stl")
        trimesh.creation.box((1.0, 2.0, 30.0)).export(folder / "tool.stl")
        write_recording(folder / "tracking.mcap", some_frames(count))
        (folder / "case.yaml").write_text(yaml.safe_dump(manifest, sort_keys=False))
        return folder

    return write
