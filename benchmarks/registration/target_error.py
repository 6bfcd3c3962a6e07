"""Ratio of the predicted to the simulated target registration error."""

from collections.abc import Iterator

import numpy as np

from app.geometry import FloatArray
from app.registration import predict_layout_tre
from app.registration.points.rigid_fit import PairNoise, fit_rigid
from benchmarks.registration.figures import Figure, rms
from tests.registration.helpers import draw, random_covariances, random_layout


def target_error(layouts: int) -> Iterator[Figure]:
    """Yield the range of the ratio over random layouts of landmarks."""
    try:
        from sksurgerycore.algorithms.errors import compute_tre_from_fle
    except ImportError:
        compute_tre_from_fle = None
    draws = 20_000 if layouts >= 100 else 4_000
    weighted_draws = 2_500 if layouts >= 100 else 600
    ratios: dict[str, list[float]] = {}
    peers = []
    rng = np.random.default_rng(3)
    for _ in range(layouts):
        landmarks = random_layout(rng, int(rng.integers(4, 9)))
        target = landmarks.mean(axis=0) + rng.normal(scale=80.0, size=3)
        equal = np.tile(0.09 * np.eye(3), (len(landmarks), 1, 1))
        own = random_covariances(rng, len(landmarks), low_mm=0.05, high_mm=0.5)
        for name, noise in (("isotropic", equal), ("anisotropic, equal weights", own)):
            truth = closed_form_errors(rng, landmarks, target, noise, draws)
            planned = predict_layout_tre(landmarks, [target], noise, matched_weights=False)[0]
            ratios.setdefault(name, []).append(planned / truth)
            if name == "isotropic" and compute_tre_from_fle is not None:
                peer = compute_tre_from_fle(landmarks, 3 * 0.09, target[None])
                peers.append(float(np.sqrt(np.ravel(peer)[0])) / truth)
        known = PairNoise.from_covariances(own, None, len(landmarks))
        errors = [
            np.linalg.norm(
                fit_rigid(landmarks + draw(rng, own), landmarks, known, "fixed", "moving").apply(
                    target
                )
                - target
            )
            for _ in range(weighted_draws)
        ]
        planned = predict_layout_tre(landmarks, [target], own, matched_weights=True)[0]
        ratios.setdefault("anisotropic, matched weights", []).append(planned / rms(errors))
    peer = f"scikit-surgery {min(peers):.2f} to {max(peers):.2f}" if peers else ""
    for name, values in ratios.items():
        yield Figure(
            "target error",
            f"predicted over Monte Carlo, {layouts} layouts, {name}",
            f"{min(values):.3f} to {max(values):.3f}",
            "0.95 to 1.05",
            peer if name == "isotropic" else "",
            min(values) >= 0.95 and max(values) <= 1.05,
        )


def closed_form_errors(
    rng: np.random.Generator,
    landmarks: FloatArray,
    target: FloatArray,
    noise: FloatArray,
    draws: int,
) -> float:
    """RMS error in mm at the target (3,) of ``draws`` vectorised closed-form registrations."""
    root = np.linalg.cholesky(noise)
    fixed = landmarks + np.einsum("nij,dnj->dni", root, rng.normal(size=(draws, len(landmarks), 3)))
    centre, means = landmarks.mean(axis=0), fixed.mean(axis=1)
    product = np.swapaxes(fixed - means[:, None], 1, 2) @ (landmarks - centre)
    left, _, right = np.linalg.svd(product)
    right[:, 2] *= np.sign(np.linalg.det(left) * np.linalg.det(right))[:, None]
    errors = (left @ right) @ (target - centre) + means - target
    return float(np.sqrt(np.mean(np.sum(errors**2, axis=1))))
