"""Statistics of tracked samples at rest, of public recordings and of made samples alike.

``python -m tests.synthetic.recorded_statistics`` prints them side by side. Only NumPy and the text
of the recordings are used: no reader of this project.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from app.geometry import Transform
from app.synthetic import SimulatedTracker, TrackerModel
from app.synthetic.tracker_model import POLARIS, TRAKSTAR

ROOT = Path(__file__).resolve().parents[2]
EIGHT = ROOT / "data" / "phantom_case" / "tracking.igs.mha"
"""EightLandmarkPointsTrackedForPhantomRegistration of PlusLibData, as the phantom case has it."""
RAS = ROOT.parent / "shared" / "data" / "plus" / "ReferenceToRASCalibration.igs.mha"

WINDOW = 12
REST_MM = 0.6
"""A rest is the longest run of `WINDOW` samples or more whose positions stay within this."""


@dataclass(frozen=True)
class Statistics:
    """Compared statistics; see `statistics`."""

    samples: int
    interval_ms: float
    interval_sd_ms: float
    doubled: float
    rest_samples: int
    jitter_mm: float
    jitter_deg: float
    step_mm: float
    repeated_positions: float
    repeated_poses: float
    autocorrelation_s: float


def statistics(times_s: np.ndarray, poses: np.ndarray) -> Statistics:
    """Statistics of ``poses`` (n, 4, 4) at ``times_s`` (n,).

    ``interval_sd_ms`` is without the gaps of more than 1.5 intervals, whose share is ``doubled``.
    Jitter is the RMS of the 3-D deviation from a straight line in each rest; ``step_mm`` is the
    smallest difference of two coordinates. ``autocorrelation_s`` is the time at which the
    autocorrelation of the deviations falls below 1/e, interpolated between samples.
    """
    gaps = np.diff(times_s)
    usual = gaps < 1.5 * np.median(gaps)
    positions = poses[:, :3, 3]
    steps = np.abs(np.diff(positions, axis=0)).ravel()
    same = (np.diff(positions, axis=0) == 0.0).all(axis=1)
    same_pose = (np.diff(poses, axis=0) == 0.0).all(axis=(1, 2))
    squares, turns, repeats, lags, count = [], [], [], [], 0
    for start, end in _rests(positions):
        off = _off_line(positions[start:end])
        rotations = Rotation.from_matrix(poses[start:end, :3, :3])
        turned = _off_line((rotations * rotations.mean().inv()).as_rotvec(degrees=True))
        squares.append((off**2).sum() / (len(off) - 2))
        turns.append((turned**2).sum() / (len(off) - 2))
        repeats.append(same[start : end - 1].mean())
        lags.append([(off[:-k] * off[k:]).sum() / (off**2).sum() for k in range(1, 8)])
        count += end - start
    correlation = np.concatenate([[1.0], np.median(lags, axis=0)])
    below = int(np.argmax(correlation < np.exp(-1.0)))
    share = (correlation[below - 1] - np.exp(-1.0)) / (correlation[below - 1] - correlation[below])
    return Statistics(
        len(times_s),
        1000.0 * float(gaps[usual].mean()),
        1000.0 * float(gaps[usual].std()),
        float(1.0 - usual.mean()),
        count,
        float(np.sqrt(np.median(squares))),
        float(np.sqrt(np.median(turns))),
        float(steps[steps > 1e-9].min()),
        float(np.mean(repeats)),
        float(same_pose.mean()),
        float((below - 1 + share) * gaps[usual].mean()),
    )


def recorded(path: Path, name: str) -> Statistics:
    """Statistics of the transform ``name`` of an IGSIO sequence."""
    return statistics(*_series(path, name))


def rests_of(path: Path, tool: str) -> list[np.ndarray]:
    """Deviations (n, 3) in mm from a straight line in each rest of ``tool``."""
    positions = _series(path, f"{tool}ToTracker")[1][:, :3, 3]
    return [_off_line(positions[start:end]) for start, end in _rests(positions)]


def _series(path: Path, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Times (n,) in s and poses (n, 4, 4)."""
    header = path.read_bytes().split(b"ElementDataFile")[0].decode("latin-1")

    def values(key: str) -> list[str]:
        return re.findall(rf"^Seq_Frame\d+_{key} = (.*?)\s*$", header, re.MULTILINE)

    poses = [np.array(text.split(), float).reshape(4, 4) for text in values(f"{name}Transform")]
    return np.array(values("Timestamp"), float), np.array(poses)


def made(model: TrackerModel, seconds: float, seed: int = 1) -> Statistics:
    """Statistics of a sensor at rest for ``seconds``, by the model."""
    tracker = SimulatedTracker(model, [seed])
    truth = Transform.from_rotation_vector(
        (0.3, -0.5, 0.9), (310.0, 12.0, -41.0), target="tracker", source="sensor"
    )
    times, poses = [], []
    for reading in tracker.readings(seconds):
        pose = tracker.measure("sensor", truth, reading.acquired_ns / 1e9).matrix
        if reading.repeated:
            pose = poses[-1]
        if not reading.skipped:
            times.append(reading.stamp_ns / 1e9)
            poses.append(pose)
    return statistics(np.array(times), np.array(poses))


TRAKSTAR_AT_15_HZ = replace(TRAKSTAR, rate_hz=1.0 / 0.06641)
POLARIS_AT_15_HZ = replace(POLARIS, rate_hz=1.0 / 0.0668, period_sd_s=0.010, stamp_sd_s=0.004)
"""The presets polled as the recordings were."""


def table() -> Mapping[str, Statistics]:
    """The recordings that are there, each followed by the preset that is like it."""
    rows = {
        "EightLandmark, stylus": recorded(EIGHT, "StylusToTracker"),
        "EightLandmark, reference": recorded(EIGHT, "ReferenceToTracker"),
        "made: trakstar at 15 Hz": made(TRAKSTAR_AT_15_HZ, 66.0),
    }
    if RAS.exists():
        rows["ReferenceToRAS, reference"] = recorded(RAS, "ReferenceToTracker")
    rows["made: polaris at 15 Hz"] = made(POLARIS_AT_15_HZ, 6.2)
    return rows


def _rests(positions: np.ndarray) -> list[tuple[int, int]]:
    found, start = [], 0
    while start + WINDOW <= len(positions):
        end = start + WINDOW
        if np.ptp(positions[start:end], axis=0).max() >= REST_MM:
            start += 1
            continue
        while end < len(positions):
            middle = positions[start:end].mean(axis=0)
            if np.abs(positions[end] - middle).max() >= REST_MM:
                break
            end += 1
        found.append((start, end))
        start = end
    return found


def _off_line(values: np.ndarray) -> np.ndarray:
    base = np.stack([np.ones(len(values)), np.arange(len(values))], axis=1)
    return values - base @ np.linalg.lstsq(base, values, rcond=None)[0]


def main() -> None:
    """Print the table."""
    rows = table()
    for field in Statistics.__dataclass_fields__:
        numbers = "".join(f"{getattr(row, field):>12.4g}" for row in rows.values())
        print(f"{field:<20}{numbers}")
    print("columns:", "; ".join(rows))


if __name__ == "__main__":
    main()
