"""Synthetic recordings with known ground truth, in the file formats of trackers."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from app.case import TrackingFrame, write_recording
from app.geometry import NS_PER_MS, Stamp, TrackedTransform, TrackingStatus, Transform

TRACKER_FROM_REFERENCE = Transform.from_rotation_vector(
    [0.4, -0.2, 1.0], [210.0, -35.0, 120.0], target="tracker", source="reference"
)
TIP_MM = np.array([12.0, -5.0, 140.0])
PIVOT_MM = np.array([40.0, 60.0, -25.0])
FACING = Rotation.from_rotvec([0.3, 2.0, -0.6])


def pivoting(rng: np.random.Generator, count: int, cone_deg: float) -> list[Transform]:
    """``reference_from_stylus`` with the tip at `PIVOT_MM`, noise 0.1 mm and 0.05 degrees RMS."""
    across = Rotation.align_vectors([TIP_MM], [[0.0, 0.0, 1.0]])[0]
    poses = []
    for index in range(count):
        around = 2.4 * index
        tilt = np.radians(cone_deg / 2.0) * np.sqrt((index + 1) / count)
        axis = across.apply([np.cos(around), np.sin(around), 0.0])
        turn = FACING * Rotation.from_rotvec(tilt * axis)
        turn = turn * Rotation.from_rotvec(rng.normal(scale=np.radians(0.05) / 1.7, size=3))
        origin = PIVOT_MM - turn.apply(TIP_MM) + rng.normal(scale=0.06, size=3)
        poses.append(Transform("reference", "stylus", turn.as_matrix(), origin))
    return poses


def spinning(rng: np.random.Generator, count: int, shaft: np.ndarray) -> list[Transform]:
    """``reference_from_stylus`` of a tool that turns about ``shaft`` (3,) through its tip."""
    poses = []
    for angle in np.linspace(0.0, 2.0, count):
        turn = FACING * Rotation.from_rotvec(angle * shaft)
        turn = turn * Rotation.from_rotvec(rng.normal(scale=np.radians(0.05), size=3))
        poses.append(
            Transform("reference", "stylus", turn.as_matrix(), PIVOT_MM - turn.apply(TIP_MM))
        )
    return poses


def frames(poses: Sequence[Transform], lost: Mapping[int, TrackingStatus]) -> list[TrackingFrame]:
    """Frames at 20 Hz with both sensors in the tracker frame; the reference moves slightly.

    ``lost``: status of the stylus in frames without a valid pose, by index.
    """
    made = []
    for index, pose in enumerate(poses):
        stamp = Stamp((1000 + 50 * index) * NS_PER_MS)
        motion = Transform.from_rotation_vector(
            [0.0, 0.0, 1e-4 * (index % 5)], [0.0, 0.01 * (index % 7), 0.0],
            target="tracker", source="tracker",
        )  # fmt: skip
        reference = motion @ TRACKER_FROM_REFERENCE
        stylus = TrackedTransform(reference @ pose, stamp, TrackingStatus.OK)
        if index in lost:
            stylus = TrackedTransform.lost("tracker", "stylus", stamp, lost[index])
        both = (TrackedTransform(reference, stamp, TrackingStatus.OK), stylus)
        made.append(TrackingFrame(stamp, both))
    return made


def write_igsio(path: Path, recorded: Sequence[TrackingFrame]) -> Path:
    """Write the text header that PLUS writes; a lost pose is an identity matrix."""
    lines = ["ObjectType = Image", "NDims = 3", f"DimSize = 0 0 {len(recorded)}"]
    for index, frame in enumerate(recorded):
        start = f"Seq_Frame{index:04}"
        for sample in frame.poses:
            name = f"{start}_{sample.source.title()}ToTrackerTransform"
            matrix = np.eye(4) if sample.transform is None else sample.transform.matrix
            lines.append(f"{name} = {' '.join(f'{number:.9g}' for number in matrix.ravel())}")
            lines.append(f"{name}Status = {sample.status.name}")
        lines.append(f"{start}_Timestamp = {frame.stamp.ns / 1e9:.4f}")
    path.write_text("\n".join([*lines, "ElementDataFile = LOCAL", ""]))
    return path


def write_mcap(path: Path, recorded: Sequence[TrackingFrame]) -> Path:
    write_recording(path, recorded)
    return path


def write_bag(folder: Path, recorded: Sequence[TrackingFrame]) -> Path:
    """Write a rosbag2 folder without metadata, as a crashed recorder leaves it."""
    folder.mkdir()
    write_mcap(folder / f"{folder.name}_0.mcap", recorded)
    return folder
