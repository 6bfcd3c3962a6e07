"""Pivot calibration with outliers over wide and narrow cones, compared with least squares."""

from collections.abc import Iterator

import numpy as np
from scipy.stats import chi2

from app.geometry import FloatArray, Transform
from app.registration import calibrate_pivot
from benchmarks.registration.figures import EM_NOISE, POSITION_NOISE, Figure, rms
from tests.registration.helpers import pivot_scene


def plain_pivot(poses: list[Transform]) -> FloatArray:
    """Tip (3,) in mm by least squares without rows beyond 3 sigma, as in SlicerIGT and IGSIO."""
    rows = np.concatenate([np.hstack([p.rotation, -np.eye(3)]) for p in poses])
    right = -np.concatenate([p.translation_mm for p in poses])
    used = np.ones(len(right), dtype=bool)
    for _ in range(2):
        solution = np.linalg.lstsq(rows[used], right[used], rcond=None)[0]
        residuals = np.abs(rows @ solution - right)
        used = residuals < residuals.mean() + 3.0 * residuals.std()
    return np.asarray(solution[:3])


def pivots(trials: int) -> Iterator[Figure]:
    """Yield tip errors for wide cones, and acceptance and coverage for narrow cones."""
    rng = np.random.default_rng(5)
    # A recording of a few seconds, and one of half a minute, where every trial has to be within.
    for count, statistic, share in ((100, "p95", 0.95), (400, "max", 1.0)):
        ours, peers = [], []
        for _ in range(trials):
            scene = pivot_scene(rng, count, cone_deg=60.0, noise=POSITION_NOISE, wrong_share=0.2)
            ours.append(float(np.linalg.norm(calibrate_pivot(scene.poses).tip_mm - scene.tip_mm)))
            peers.append(float(np.linalg.norm(plain_pivot(scene.poses) - scene.tip_mm)))
        yield Figure(
            "pivot",
            f"60 degree cone, 0.5 mm, 20 % wrong, {count} poses, {trials} trials",
            f"{rms(ours):.3f} RMS, {np.quantile(ours, 0.95):.3f} p95, {max(ours):.3f} max mm",
            f"0.3 mm ({statistic})",
            f"least squares of IGSIO {rms(peers):.2f} RMS, {max(peers):.2f} max mm",
            bool(np.quantile(ours, share) <= 0.3),
        )
    for name, noise in (("0.5 mm", POSITION_NOISE), ("0.5 mm and 0.3 degrees", EM_NOISE)):
        covered, accepted, ours, peers, residuals = 0, 0, [], [], []
        for _ in range(trials):
            scene = pivot_scene(rng, 100, cone_deg=20.0, noise=noise, wrong_share=0.2)
            result = calibrate_pivot(scene.poses)
            error = result.tip_mm - scene.tip_mm
            squared = error @ np.linalg.solve(result.covariance[:3, :3], error)
            covered += bool(squared < chi2.ppf(0.95, 3))
            accepted += result.accepted
            residuals.append(result.rms_mm)
            ours.append(float(np.linalg.norm(error)))
            peers.append(float(np.linalg.norm(plain_pivot(scene.poses) - scene.tip_mm)))
        yield Figure(
            "pivot",
            f"20 degree cone, {name}, 20 % wrong, {trials} trials",
            f"{accepted} accepted; sigma covers {covered / trials:.1%}; error {rms(ours):.2f} RMS "
            f"with a residual of {np.mean(residuals):.2f} mm",
            "refused, or 95 % covered",
            f"least squares of IGSIO: error {rms(peers):.2f} RMS",
            accepted == 0 or covered / trials >= 0.93,
        )
