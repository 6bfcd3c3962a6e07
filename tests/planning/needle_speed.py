"""Time of a plan of 100 000 entries, beside coal on a part of the same needles, in one run.

Run ``python -m tests.planning.needle_speed``. Coal measures the distance of each needle to each
structure, as one segment, on one thread and without a limit.
"""

import time
from collections.abc import Callable

import numpy as np
import trimesh

from app.geometry import SurfaceMesh
from app.planning import EntryRegion, ForbiddenStructure, Needle, NeedleTarget, plan_needle
from tests.oracles.needle_oracle import NeedleOracle
from tests.planning.needle_scenes import FRAME, blob

ENTRIES, OF_COAL = 100_000, 2000


def measured(run: Callable[[], object]) -> tuple[float, float]:
    """Wall time and processor time in s."""
    wall, processor = time.perf_counter(), time.process_time()
    run()
    return time.perf_counter() - wall, time.process_time() - processor


def main() -> None:
    rng = np.random.default_rng(1)
    places = [(0.0, 0.0, 30.0), (20.0, 5.0, 35.0), (-15.0, 15.0, 25.0), (0.0, 0.0, -60.0)]
    sizes = (6.0, 10.0, 8.0, 40.0)
    structures = [
        ForbiddenStructure(f"structure {k}", blob(rng, np.array(place), size, 5), 2.0, 0.5)
        for k, (place, size) in enumerate(zip(places, sizes, strict=True))
    ]
    ball = trimesh.creation.icosphere(5, 70.0)
    top = (ball.vertices[ball.faces, 2] > 20.0).all(axis=1)
    skin = SurfaceMesh(FRAME, ball.vertices, ball.faces[top])
    region = EntryRegion.of_surface(skin, count=ENTRIES)
    target = NeedleTarget.of_points(FRAME, [[0.0, 0.0, 0.0]])
    needle = Needle(100.0, 1.2, 1.0)

    def plan() -> object:
        return plan_needle(region, target, needle, structures, error=1.0, k_sigma=2.0)

    plan()  # compiles
    wall, processor = min(measured(plan) for _ in range(5))
    faces = sum(len(each.surface.faces) for each in structures)
    print(f"{len(region.points_mm)} entries, {len(structures)} structures of {faces} faces")
    print(f"plan: {wall:.2f} s, {processor:.2f} s of the processor")
    oracles = [NeedleOracle(each.surface) for each in structures]
    some = rng.choice(len(region.points_mm), OF_COAL, replace=False)

    def coal() -> None:
        for index in some:
            for oracle in oracles:
                oracle.clearance(region.points_mm[index], target.points_mm[0], 0.6)

    wall, processor = measured(coal)
    share = len(region.points_mm) / OF_COAL
    print(f"coal: {wall * share:.1f} s, {processor * share:.1f} s of the processor for all entries")


if __name__ == "__main__":
    main()
