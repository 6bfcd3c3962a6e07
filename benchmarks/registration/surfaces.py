"""Surface registration compared with the ICP of trimesh."""

import time
from collections.abc import Iterator

import numpy as np
import trimesh

from app.registration import register_surface
from app.registration.motion import motion_between
from benchmarks.registration.figures import Figure, rms
from tests.registration.surfaces import ASYMMETRIC_SURFACE, mesh_of, touch_surface


def surfaces(trials: int) -> Iterator[Figure]:
    """Yield the error at the centre, and whether the covariance holds."""
    rng = np.random.default_rng(7)
    ours, peers, normalised, times = [], [], [], [0.0, 0.0]
    for _ in range(trials):
        truth, points, start = touch_surface(rng, ASYMMETRIC_SURFACE, 40, 0.3)
        begin = time.perf_counter()
        result = register_surface(points, mesh_of(ASYMMETRIC_SURFACE), start=start)
        between = time.perf_counter()
        peer, _, _ = trimesh.registration.icp(
            points,
            ASYMMETRIC_SURFACE,
            initial=start.matrix,
            threshold=1e-7,
            max_iterations=60,
            reflection=False,
            scale=False,
        )
        times[0] += between - begin
        times[1] += time.perf_counter() - between
        centre = truth.inverse().apply(np.zeros(3))
        ours.append(float(np.linalg.norm(result.transform.apply(centre))))
        peers.append(float(np.linalg.norm(peer[:3, :3] @ centre + peer[:3, 3])))
        motion = motion_between(truth, result.transform)
        normalised.append(float(motion @ np.linalg.solve(result.covariance, motion)) / 6.0)
    yield Figure(
        "surface",
        f"40 touched points, 0.3 mm, {trials} trials, error at the centre",
        f"{rms(ours):.3f} RMS mm from 7 starts in {1e3 * times[0] / trials:.0f} ms",
        "",
        f"trimesh ICP {rms(peers):.3f} RMS mm from one in {1e3 * times[1] / trials:.0f} ms",
        None,
    )
    yield Figure(
        "surface",
        "normalised squared error (noise estimated from 34 degrees of freedom: 1.06)",
        f"{np.mean(normalised):.2f}",
        "",
        "not available in trimesh",
        None,
    )
