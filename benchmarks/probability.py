"""Probability of a breach over simulated cases: reliability, Brier score.

In each case a cautery passes a lobed tumour. Its measured pose has an error of registration, pivot
and contour that is constant over the case, and jitter: white, and slow. The analysis sees the
distances and normals that the engine computes from the measured poses, and the covariances of the
errors. The truth is independent of it: the true poses at four times the rate, and the radius
function of the tumour (`app.synthetic.Clearance`), neither mesh nor engine.
"""

import argparse
import json
import math
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from app.analysis.breach_probability import breach_probability, smoothed_distances
from app.fixture.proximity.engine import ProximityEngine
from app.geometry import FloatArray, Transform
from app.geometry.rotation_vectors import rotation_of_vector
from app.synthetic.cautery import CAUTERY_TIP_FRAME, cautery_mesh
from app.synthetic.clearance import Clearance
from app.synthetic.tumour import TUMOR_FRAME, Tumour

CASES_PER_TUMOUR = 100
RATE_HZ, CASE_S, TRUE_PER_FRAME = 40.0, 4.0, 4
JITTER_MM, SLOW_S = 0.12, 0.3
"""RMS of the white and of the slow jitter, along each axis; correlation time of the slow one."""
ERROR_SCALE = 1.0
"""Of the standard deviations of the constant errors: 0.2 to 0.9 mm along each axis."""
BINS = 10
MAX_MISS = 0.02
"""Difference of the shares of a bin beyond three standard deviations of chance."""
MAX_BRIER_EXCESS = 0.01
"""Of the Brier score over the one that calibrated probabilities have."""


@dataclass(frozen=True)
class Prediction:
    """The probability that the analysis gives, and whether the tool was in the tumour."""

    probability: float
    breach: bool


@dataclass(frozen=True)
class Bin:
    """Cases whose probability is in one tenth: mean of it, share of true breaches."""

    cases: int
    predicted: float
    observed: float

    @property
    def spread(self) -> float:
        """Standard deviation of the observed share by chance."""
        return math.sqrt(self.predicted * (1.0 - self.predicted) / self.cases)

    @property
    def is_calibrated(self) -> bool:
        """True if both shares agree within chance and `MAX_MISS`."""
        return abs(self.observed - self.predicted) <= MAX_MISS + 3.0 * self.spread


def predictions(count: int, seed: int) -> Iterator[Prediction]:
    """Simulate ``count`` cases; a hundred of them have the same tumour."""
    tool = cautery_mesh()
    for number in range(count):
        random = np.random.default_rng([seed, number])
        if number % CASES_PER_TUMOUR == 0:
            tumour = Tumour.generate(random)
            clearance = Clearance(tumour, tool)
            engine = ProximityEngine(tumour.mesh(), tool)
        yield _case(random, tumour, clearance, engine)


def _case(
    random: np.random.Generator, tumour: Tumour, clearance: Clearance, engine: ProximityEngine
) -> Prediction:
    frames = int(RATE_HZ * CASE_S)
    poses = _motion(random, tumour, frames * TRUE_PER_FRAME)
    breach = any(clearance.height_mm(pose) < 0.0 for pose in poses)
    # Pivot: an error along the tool is twice that across it. All of them are constant.
    turn = poses[len(poses) // 2].rotation
    pivot = np.diag(random.uniform(0.1, 0.5) * np.array([1.0, 1.0, 2.0])) ** 2
    covariances = {
        "registration": np.diag(random.uniform(0.2, 0.9, 3)) ** 2,
        "pivot": turn @ pivot @ turn.T,
        "contour": random.uniform(0.2, 0.7) ** 2 * np.eye(3),
    }
    covariances = {name: ERROR_SCALE**2 * matrix for name, matrix in covariances.items()}
    error = random.multivariate_normal(np.zeros(3), sum(covariances.values(), np.zeros((3, 3))))
    measured = [
        engine.evaluate(_shifted(pose, error + jitter))
        for pose, jitter in zip(poses[::TRUE_PER_FRAME], _jitter(random, frames), strict=True)
    ]
    times = np.arange(frames) / RATE_HZ
    distances = np.array([each.signed_distance_mm for each in measured])
    normals = np.array([each.normal for each in measured])
    held = np.full(frames, 1.0 / RATE_HZ)
    found = breach_probability(smoothed_distances(times, distances), normals, held, covariances)
    return Prediction(found.outcome.probability, breach)


def _motion(random: np.random.Generator, tumour: Tumour, count: int) -> list[Transform]:
    """True poses: along the tumour from one direction to another, nearest in the middle."""
    first = random.normal(size=3)
    first /= np.linalg.norm(first)
    axis = np.cross(first, random.normal(size=3))
    axis *= random.uniform(0.2, 1.0) / np.linalg.norm(axis)
    tilt = rotation_of_vector(0.4 * random.normal(size=3))
    height, lift = random.uniform(-2.5, 5.0), random.uniform(2.0, 6.0)
    poses = []
    for share in np.linspace(-1.0, 1.0, count).tolist():
        out = rotation_of_vector(share * axis) @ first
        distance = float(tumour.radius_mm(out[None])[0]) + height + lift * share**2
        # The tool points inward: its +z is against the direction, tilted.
        side = np.cross(out, axis)
        side /= np.linalg.norm(side)
        inward = np.stack([side, np.cross(-out, side), -out], axis=1)
        poses.append(Transform(TUMOR_FRAME, CAUTERY_TIP_FRAME, tilt @ inward, distance * out))
    return poses


def _jitter(random: np.random.Generator, count: int) -> FloatArray:
    """Jitter (n, 3) of the frames, in mm."""
    kept = math.exp(-1.0 / (RATE_HZ * SLOW_S))
    slow, fresh = np.empty((count, 3)), random.normal(size=(count, 3))
    slow[0] = fresh[0]
    for k in range(1, count):
        slow[k] = kept * slow[k - 1] + math.sqrt(1.0 - kept**2) * fresh[k]
    return np.asarray(JITTER_MM * (slow + random.normal(size=(count, 3))))


def _shifted(pose: Transform, shift: FloatArray) -> Transform:
    return Transform(pose.target, pose.source, pose.rotation, pose.translation_mm + shift)


def bins_of(found: Sequence[Prediction]) -> list[Bin]:
    """The cases by tenths of their probability; tenths without a case are left out."""
    probabilities = np.array([each.probability for each in found])
    breaches = np.array([each.breach for each in found], dtype=float)
    tenth = np.minimum((probabilities * BINS).astype(int), BINS - 1)
    chosen = [tenth == number for number in range(BINS)]
    return [
        Bin(int(mask.sum()), float(probabilities[mask].mean()), float(breaches[mask].mean()))
        for mask in chosen
        if mask.any()
    ]


def figures(found: Sequence[Prediction]) -> dict[str, float]:
    """Brier scores: as found, of calibrated probabilities, of the share of breaches for all."""
    probabilities = np.array([each.probability for each in found])
    breaches = np.array([each.breach for each in found], dtype=float)
    return {
        "cases": len(found),
        "breaches": float(breaches.mean()),
        "mean probability": float(probabilities.mean()),
        "Brier score": float(np.mean((probabilities - breaches) ** 2)),
        "Brier score if calibrated": float(np.mean(probabilities * (1.0 - probabilities))),
        "Brier score of the share of breaches": float(breaches.mean() * (1.0 - breaches.mean())),
    }


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the benchmark and print its figures. Status 1 if a goal is missed."""
    parser = argparse.ArgumentParser(description=__doc__, prog="marginguard bench probability")
    parser.add_argument("--cases", type=int, default=2000, help="simulated cases (2000)")
    parser.add_argument("--seed", type=int, default=1, help="seed (1)")
    parser.add_argument("--plot", type=Path, help="file for the reliability diagram (SVG, PNG)")
    parser.add_argument("--json", type=Path, help="file for the figures")
    options = parser.parse_args(arguments)
    if options.cases < 1:
        parser.error(f"--cases is {options.cases}; expected 1 or more")
    found = list(predictions(options.cases, options.seed))
    bins, values = bins_of(found), figures(found)
    print("| cases | mean probability | share of breaches | standard deviation by chance |")
    for each in bins:
        print(
            f"| {each.cases} | {each.predicted:.3f} | {each.observed:.3f} | {each.spread:.3f} |"
            + ("" if each.is_calibrated else " MISSED")
        )
    for name, value in values.items():
        print(f"{name}: {value:.4g}")
    excess = values["Brier score"] - values["Brier score if calibrated"]
    met = excess <= MAX_BRIER_EXCESS and all(each.is_calibrated for each in bins)
    goals = f"each tenth within {MAX_MISS:g} of chance, Brier score within {MAX_BRIER_EXCESS:g}"
    print(f"calibrated ({goals}): {'yes' if met else 'no'}")
    if options.json is not None:
        rows = [vars(each) for each in bins]
        options.json.write_text(json.dumps({**values, "bins": rows}, indent=2) + "\n")
    if options.plot is not None:
        from benchmarks.probability_plot import write_plot

        write_plot(options.plot, bins, values)
    return int(not met)


if __name__ == "__main__":
    sys.exit(main())
