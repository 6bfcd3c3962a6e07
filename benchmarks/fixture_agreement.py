"""Signs and distances of the fixture against an independent judge, over very many poses.

    python -m benchmarks.fixture_agreement --signs 1000000 --distances 20000

Exit status 1 when a sign is wrong beyond 0.05 mm of the surface, a lower bound is above the
judge's distance, or a distance is off by more than 0.02 mm RMS or 0.1 mm.
"""

import argparse
import json
import sys
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

import numpy as np

from app.fixture import ProximityEngine
from benchmarks.fixture_oracle import Oracle, random_pose
from benchmarks.fixture_shapes import TOOLS, TUMORS, tool, tumor

NEAR_MM = 0.05
PAIRS = [(tumor_kind, tool_kind) for tumor_kind in TUMORS for tool_kind in TOOLS]


def signs(pair: int, poses: int) -> dict[str, object]:
    """Count the wrong signs of one pair, tumours of some 1000 triangles."""
    meshes = tumor(PAIRS[pair][0], 3), tool(PAIRS[pair][1])
    engine, oracle = ProximityEngine(*meshes), Oracle.of(*meshes, samples=10)
    rng = np.random.default_rng([1, pair])
    judged = inside = wholly = engulfed = grazing = wrong = 0
    for _ in range(poses):
        pose = random_pose(rng, spread_mm=7.0)
        found = engine.evaluate(pose)
        distance = found.signed_distance_mm
        grazing += abs(distance) < 0.5
        if abs(distance) <= NEAR_MM:
            continue
        expected = oracle.overlaps(pose)
        judged += 1
        inside += expected
        wholly += expected and not found.contact
        engulfed += expected and not found.contact and oracle.tool_holds_tumor(pose)
        wrong += expected != (distance < 0.0)
    return {
        "pair": " / ".join(PAIRS[pair]), "poses": poses, "judged": judged, "inside": inside,
        "without_contact": wholly, "tumor_in_tool": engulfed, "within_half_mm": grazing,
        "wrong": wrong,
    }  # fmt: skip


def distances(pair: int, poses: int) -> dict[str, object]:
    """Compare the distances of one pair, tumours of 20480 triangles and more."""
    meshes = tumor(PAIRS[pair][0], 5), tool(PAIRS[pair][1])
    engine, oracle = ProximityEngine(*meshes), Oracle.of(*meshes, samples=200_000)
    rng = np.random.default_rng([2, pair])
    errors, bounds = [], []
    while len(errors) < poses:
        pose = random_pose(rng, spread_mm=7.0)
        if oracle.tool_holds_tumor(pose):
            continue  # the judge's distance knows the tool's surface only
        found = engine.evaluate(pose)
        sampled = oracle.signed_distance_mm(pose)
        errors.append(found.signed_distance_mm - sampled)
        bounds.append(sampled - found.lower_bound_mm)
    return {
        "pair": " / ".join(PAIRS[pair]), "poses": poses,
        "above_bound": int(np.sum(np.less(bounds, 0))),
        "rms_mm": float(np.sqrt(np.mean(np.square(errors)))), "max_mm": float(np.abs(errors).max()),
    }  # fmt: skip


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--signs", type=int, default=20_000, help="poses over all pairs")
    parser.add_argument("--distances", type=int, default=400, help="poses over all pairs")
    parser.add_argument("--workers", type=int, default=2)
    options = parser.parse_args()
    count = len(PAIRS)
    # Each pair once here first: workers then find the kernels compiled.
    signs(0, 1)
    with ProcessPoolExecutor(options.workers, mp_context=get_context("spawn")) as pool:
        signed = list(pool.map(signs, range(count), [-(-options.signs // count)] * count))
        measured = list(pool.map(distances, range(count), [-(-options.distances // count)] * count))
    for row in (*signed, *measured):
        print(json.dumps(row))
    wrong = sum(row["wrong"] for row in signed)
    above = sum(row["above_bound"] for row in measured)
    rms = float(np.sqrt(np.mean([row["rms_mm"] ** 2 for row in measured])))
    worst = max(row["max_mm"] for row in measured)
    print(
        f"signs: {wrong} wrong of {sum(row['judged'] for row in signed)} judged "
        f"({sum(row['poses'] for row in signed)} poses); distances over "
        f"{sum(row['poses'] for row in measured)} poses: RMS {rms:.4f} mm, max {worst:.4f} mm, "
        f"{above} below the lower bound"
    )
    return 1 if wrong or above or rms > 0.02 or worst > 0.1 else 0


if __name__ == "__main__":
    sys.exit(main())
