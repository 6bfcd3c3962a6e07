"""What registration and calibration reach, each figure beside that of a peer in the same run.

    python benchmarks/registration.py [--quick] [--only TOPIC] [--json FILE]

Exit status 1 when a figure is not what is wanted of it.
"""

import argparse
import json
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import trimesh
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from app.geometry import FloatArray, Transform  # noqa: E402
from app.registration import (  # noqa: E402
    PoseNoise,
    RegistrationError,
    TimedSignal,
    calibrate_pivot,
    calibrate_spin,
    detect_landmarks,
    estimate_time_offset,
    predict_layout_tre,
    register_points,
    register_surface,
    solve_robot_world,
)
from app.registration.motion import difference  # noqa: E402
from app.registration.rigid_fit import PairNoise, fit_rigid  # noqa: E402
from tests.registration.helpers import (  # noqa: E402
    draw,
    pivot_scene,
    random_covariances,
    random_layout,
    random_transform,
    robot_world_scene,
)

EM_NOISE = PoseNoise.from_rms(rotation_deg=0.3, translation_mm=0.5)
POSITION_NOISE = PoseNoise.from_rms(rotation_deg=1e-6, translation_mm=0.5)
FRAMES = {"fixed_frame": "fixed", "moving_frame": "moving"}


@dataclass(frozen=True)
class Figure:
    """One line of the table; ``good`` is None where nothing was asked for."""

    topic: str
    what: str
    ours: str
    wanted: str
    peer: str
    good: bool | None

    def __post_init__(self) -> None:
        if self.good is not None:
            object.__setattr__(self, "good", bool(self.good))


def rms(values: list[float]) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def noise_free(trials: int) -> Iterator[Figure]:
    rng = np.random.default_rng(1)
    worst = {"points": [0.0, 0.0], "robot-world": [0.0, 0.0], "pivot": [0.0, 0.0]}

    def note(name: str, millimetres: float, radians: float) -> None:
        worst[name] = [max(worst[name][0], millimetres), max(worst[name][1], radians)]

    for _ in range(trials):
        truth, moving = random_transform(rng), random_layout(rng, int(rng.integers(3, 12)))
        found = register_points(truth.apply(moving), moving, **FRAMES).transform
        gaps = np.abs(found.apply(moving) - truth.apply(moving)).max()
        note("points", float(gaps), found.angle_to(truth))
        scene = robot_world_scene(rng, 10, None)
        result = solve_robot_world(scene.robot, scene.sensor, noise=EM_NOISE)
        for one, other in (
            (result.reference_from_base, scene.base),
            (result.tip_from_sensor, scene.mount),
        ):
            note("robot-world", one.distance_mm_to(other), one.angle_to(other))
        pivot = pivot_scene(rng, 30, cone_deg=rng.uniform(31, 120), noise=None)
        tip = calibrate_pivot(pivot.poses, noise=EM_NOISE).tip_mm
        note("pivot", float(np.abs(tip - pivot.tip_mm).max()), 0.0)
    for name, (millimetres, radians) in worst.items():
        yield Figure(
            "noise-free",
            f"{name}: worst of {trials} random geometries",
            f"{millimetres:.1e} mm, {radians:.1e} rad",
            "1e-9 mm, 1e-10 rad",
            "",
            millimetres <= 1e-9 and radians <= 1e-10,
        )


def recording(_: int) -> Iterator[Figure]:
    folder = ROOT.parent / "shared" / "data" / "plus"
    if not folder.is_dir():
        yield Figure("recording", "eight landmarks", "no real recording here", "", "", None)
        return
    from lxml import etree

    from tests.registration.test_landmarks import numbers, recorded_tips

    samples, landmarks = recorded_tips(folder)
    expected = etree.parse(folder / "PhantomRegistrationLandmarkDetection.results.xml")
    entry = expected.find(".//Transform[@From='Phantom']")
    published = Transform.from_matrix(
        numbers(entry.get("Matrix")), target="reference", source="phantom"
    )
    begin = time.perf_counter()
    detected = detect_landmarks(samples, landmarks)
    pairs = detected.match.pairs
    result = register_points(
        [detected.dwells[dwell].position_mm for dwell, _ in pairs],
        [landmarks[name] for _, name in pairs],
        fixed_frame="reference",
        moving_frame="phantom",
    )
    took = time.perf_counter() - begin
    yield Figure(
        "recording",
        "landmarks found and named, their order not told",
        f"{len(pairs)} of {len(landmarks)} in {1e3 * took:.0f} ms",
        "8 of 8",
        "PLUS is told the order",
        len(pairs) == 8,
    )
    distance = result.transform.distance_mm_to(published)
    angle = float(np.degrees(result.transform.angle_to(published)))
    yield Figure(
        "recording",
        "PhantomToReference against the published one",
        f"{distance:.3f} mm, {angle:.3f} degrees",
        "0.10 mm, 0.30 degrees",
        "",
        distance <= 0.10 and angle <= 0.30,
    )
    mean = float(result.residuals_mm.mean())
    yield Figure(
        "recording",
        "mean residual",
        f"{mean:.3f} mm",
        "0.21 mm",
        f"PLUS {float(entry.get('Error')):.3f} mm",
        mean <= 0.21,
    )


def robot_world(trials: int) -> Iterator[Figure]:
    import cv2

    rng = np.random.default_rng(2)
    errors: dict[str, list[float]] = {}
    for _ in range(trials):
        scene = robot_world_scene(rng, 15, EM_NOISE)
        middle = scene.base.inverse().apply(scene.centre_mm)
        world, gripper = (
            [p.inverse() for p in scene.sensor],
            [p.inverse() for p in scene.robot],
        )
        answers = {
            "known noise": solve_robot_world(
                scene.robot, scene.sensor, noise=EM_NOISE
            ).reference_from_base,
            "noise estimated": solve_robot_world(scene.robot, scene.sensor).reference_from_base,
        }
        for name, method in (("Shah", 0), ("Li", 1)):
            rotation, translation, _, _ = cv2.calibrateRobotWorldHandEye(
                [p.rotation for p in world],
                [p.translation_mm for p in world],
                [p.rotation for p in gripper],
                [p.translation_mm for p in gripper],
                method=method,
            )
            answers[name] = Transform("reference", "base", rotation, translation.ravel())
        for name, answer in answers.items():
            miss = np.linalg.norm(answer.apply(middle) - scene.centre_mm)
            errors.setdefault(name, []).append(float(miss))
    told = {
        name: f"{rms(values):.3f} RMS, {np.quantile(values, 0.95):.3f} p95"
        for name, values in errors.items()
    }
    peers = f"OpenCV Shah {told['Shah']}; Li {told['Li']}"
    for name in ("known noise", "noise estimated"):
        good = rms(errors[name]) <= 0.30 and np.quantile(errors[name], 0.95) <= 0.45
        yield Figure(
            "robot-world",
            f"base at the workspace centre, 15 poses, {trials} trials, {name}",
            told[name] + " mm",
            "0.30 RMS, 0.45 p95 mm",
            peers,
            bool(good),
        )


def target_error(layouts: int) -> Iterator[Figure]:
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
        known = PairNoise.of(own, None, len(landmarks))
        misses = [
            np.linalg.norm(
                fit_rigid(landmarks + draw(rng, own), landmarks, known, "fixed", "moving").apply(
                    target
                )
                - target
            )
            for _ in range(weighted_draws)
        ]
        planned = predict_layout_tre(landmarks, [target], own, matched_weights=True)[0]
        ratios.setdefault("anisotropic, matched weights", []).append(planned / rms(misses))
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
    """RMS error at the target of ``draws`` closed-form registrations, all at once."""
    root = np.linalg.cholesky(noise)
    fixed = landmarks + np.einsum("nij,dnj->dni", root, rng.normal(size=(draws, len(landmarks), 3)))
    centre, means = landmarks.mean(axis=0), fixed.mean(axis=1)
    product = np.swapaxes(fixed - means[:, None], 1, 2) @ (landmarks - centre)
    left, _, right = np.linalg.svd(product)
    right[:, 2] *= np.sign(np.linalg.det(left) * np.linalg.det(right))[:, None]
    misses = (left @ right) @ (target - centre) + means - target
    return float(np.sqrt(np.mean(np.sum(misses**2, axis=1))))


def calibration_of_covariances(trials: int) -> Iterator[Figure]:
    # One stream of numbers each, so that no figure depends on what ran before it.
    streams = [np.random.default_rng([4, index]) for index in range(4)]

    def points(rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
        truth, moving = random_transform(rng), random_layout(rng, 6)
        noise = random_covariances(rng, 6)
        fixed = truth.apply(moving) + draw(rng, noise)
        result = register_points(fixed, moving, covariances_mm2=noise, **FRAMES)
        return difference(truth, result.transform), np.asarray(result.covariance)

    def base(rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
        scene = robot_world_scene(rng, 15, EM_NOISE)
        result = solve_robot_world(scene.robot, scene.sensor, noise=EM_NOISE)
        motion = [
            difference(scene.base, result.reference_from_base),
            difference(scene.mount, result.tip_from_sensor),
        ]
        return np.concatenate(motion), result.covariance

    def pivot(rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
        scene = pivot_scene(rng, 80, cone_deg=60.0, noise=EM_NOISE)
        result = calibrate_pivot(scene.poses, noise=EM_NOISE)
        return result.tip_mm - scene.tip_mm, result.covariance[:3, :3]

    def spin(rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
        scene = pivot_scene(rng, 200, cone_deg=0.0, noise=EM_NOISE, spin_deg=40.0)
        result = calibrate_spin(scene.poses, tip_mm=scene.tip_mm)
        across = np.linalg.svd(result.shaft[None])[2][1:]
        error = across @ (scene.tip_mm / np.linalg.norm(scene.tip_mm) - result.shaft)
        return error, across @ result.covariance @ across.T

    for trial, rng in zip((points, base, pivot, spin), streams, strict=True):
        squared, size = [], 0
        for _ in range(trials):
            error, covariance = trial(rng)
            squared.append(float(error @ np.linalg.solve(covariance, error)))
            size = len(error)
        # Few trials are a smoke test of four bands at once: they are not to fail one time in five.
        tail = 0.025 if trials >= 500 else 0.0005
        low, high = chi2.ppf([tail, 1.0 - tail], size * trials) / (size * trials)
        mean = float(np.mean(squared)) / size
        yield Figure(
            "covariance",
            f"normalised squared error, {trial.__name__}, {trials} trials",
            f"{mean:.3f}",
            f"{low:.3f} to {high:.3f}",
            "no peer states one",
            low <= mean <= high,
        )


def plain_pivot(poses: list[Transform]) -> FloatArray:
    """Least squares with rows beyond 3 sigma dropped, as SlicerIGT and IGSIO do it."""
    rows = np.concatenate([np.hstack([p.rotation, -np.eye(3)]) for p in poses])
    right = -np.concatenate([p.translation_mm for p in poses])
    kept = np.ones(len(right), dtype=bool)
    for _ in range(2):
        solution = np.linalg.lstsq(rows[kept], right[kept], rcond=None)[0]
        misses = np.abs(rows @ solution - right)
        kept = misses < misses.mean() + 3.0 * misses.std()
    return np.asarray(solution[:3])


def pivots(trials: int) -> Iterator[Figure]:
    rng = np.random.default_rng(5)
    for count in (100, 200):
        ours, peers = [], []
        for _ in range(trials):
            scene = pivot_scene(rng, count, cone_deg=60.0, noise=POSITION_NOISE, wrong_share=0.2)
            ours.append(float(np.linalg.norm(calibrate_pivot(scene.poses).tip_mm - scene.tip_mm)))
            peers.append(float(np.linalg.norm(plain_pivot(scene.poses) - scene.tip_mm)))
        yield Figure(
            "pivot",
            f"60 degree cone, 0.5 mm, 20 % wrong, {count} poses, {trials} trials",
            f"{rms(ours):.3f} RMS, {np.quantile(ours, 0.95):.3f} p95, {max(ours):.3f} max mm",
            "0.3 mm (p95)",
            f"least squares of IGSIO {rms(peers):.2f} RMS, {max(peers):.2f} max mm",
            bool(np.quantile(ours, 0.95) <= 0.3),
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


def time_offsets(trials: int) -> Iterator[Figure]:
    from tests.registration.test_time_offset import LAG_MS, streams

    rng = np.random.default_rng(6)
    errors, peers, covered = [], [], 0
    for _ in range(trials):
        a, b = streams(rng)
        result = estimate_time_offset(a, b)
        errors.append(result.offset_ns / 1e6 - LAG_MS)
        covered += result.interval_ns[0] <= LAG_MS * 1e6 <= result.interval_ns[1]
        peers.append(principal_axis_offset(a, b) - LAG_MS)
    yield Figure(
        "time offset",
        f"65 ms at 50 Hz with jitter, 20 s, {trials} trials",
        f"{rms(errors):.3f} RMS, {np.abs(errors).max():.3f} max ms",
        "1 ms",
        f"principal axis at 1 ms steps {rms(peers):.2f} RMS, {np.abs(peers).max():.1f} max ms",
        bool(np.quantile(np.abs(errors), 0.95) <= 1.0),
    )
    yield Figure(
        "time offset",
        "95 % interval covers the truth",
        f"{covered / trials:.1%}",
        "95 %",
        "no peer states one",
        covered / trials >= 0.925,
    )


def principal_axis_offset(a: TimedSignal, b: TimedSignal) -> float:
    """As PLUS does it: positions along their principal axis, resampled, least squares in steps."""

    def along(signal: TimedSignal) -> tuple[FloatArray, FloatArray]:
        centred = signal.values - signal.values.mean(axis=0)
        axis = np.linalg.svd(centred, full_matrices=False)[2][0]
        values = centred @ axis
        return signal.times_ns / 1e9, values / values.std()

    (a_times, a_values), (b_times, b_values) = along(a), along(b)
    grid = np.arange(b_times[0] + 0.6, b_times[-1] - 0.6, 0.01)
    seen = np.interp(grid, b_times, b_values)
    steps = np.arange(-0.5, 0.5005, 0.001)
    losses = [
        min(np.sum((seen - sign * np.interp(grid - s, a_times, a_values)) ** 2) for sign in (1, -1))
        for s in steps
    ]
    return float(1e3 * steps[int(np.argmin(losses))])


def surfaces(trials: int) -> Iterator[Figure]:
    from tests.registration.test_surface import BONE, mesh_of, touched

    rng = np.random.default_rng(7)
    ours, peers, stated, times = [], [], [], [0.0, 0.0]
    for _ in range(trials):
        truth, points, start = touched(rng, BONE, 40, 0.3)
        begin = time.perf_counter()
        result = register_surface(points, mesh_of(BONE), start=start)
        between = time.perf_counter()
        peer, _, _ = trimesh.registration.icp(
            points,
            BONE,
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
        motion = difference(truth, result.transform)
        stated.append(float(motion @ np.linalg.solve(result.covariance, motion)) / 6.0)
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
        f"{np.mean(stated):.2f}",
        "",
        "no peer states one",
        None,
    )


def bad_input(_: int) -> Iterator[Figure]:
    box = np.array([[0, 0, 0], [80, 0, 0], [0, 60, 0], [0, 0, 40], [70, 50, 30.0]])
    line = np.outer(np.arange(5.0), [10.0, 20, 5])
    nan, infinite = box.copy(), box.copy()
    nan[1, 1], infinite[1, 1] = np.nan, np.inf
    turned = Rotation.from_rotvec([0.1, 0.2, 0.3]).as_matrix()
    pose = Transform("reference", "tool", turned, np.array([1.0, 2.0, 3.0]))
    cases: dict[str, Callable[[], object]] = {
        "two points": lambda: register_points(box[:2], box[:2], **FRAMES),
        "coincident": lambda: register_points(np.ones((4, 3)), box[:4], **FRAMES),
        "collinear": lambda: register_points(line, line, **FRAMES),
        "nearly collinear": lambda: register_points(line + box / 50, line + box / 50, **FRAMES),
        "mirrored": lambda: register_points(box, box * [1, 1, -1], **FRAMES),
        "NaN": lambda: register_points(box, nan, **FRAMES),
        "infinite": lambda: register_points(infinite, box, **FRAMES),
        "unequal counts": lambda: register_points(box, box[:4], **FRAMES),
        "one pose repeated (pivot)": lambda: calibrate_pivot([pose] * 20),
        "one pose repeated (spin)": lambda: calibrate_spin([pose] * 20, tip_mm=[0, 0, 100.0]),
        "one pose repeated (robot-world)": lambda: solve_robot_world([pose] * 9, [pose] * 9),
    }
    for name, call in cases.items():
        try:
            call()
        except RegistrationError as refusal:
            yield Figure("bad input", name, f"{type(refusal).__name__}: {refusal}", "", "", True)
        else:
            yield Figure("bad input", name, "went through", "a typed error", "", False)


TOPICS: tuple[tuple[Callable[[int], Iterator[Figure]], int, int], ...] = (
    (recording, 1, 1),
    (noise_free, 1000, 30),
    (robot_world, 200, 20),
    (target_error, 100, 5),
    (calibration_of_covariances, 500, 40),
    (pivots, 200, 20),
    (time_offsets, 400, 40),
    (surfaces, 40, 5),
    (bad_input, 1, 1),
)
"""What is run, with its trials in full and with ``--quick``."""


def run(*, quick: bool, only: str = "") -> Iterator[Figure]:
    """Every figure as it is found, of the topics whose name holds ``only``."""
    for topic, full, short in TOPICS:
        if only in topic.__name__:
            yield from topic(short if quick else full)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="few trials: figures are rough")
    parser.add_argument("--only", default="", help="topics whose name holds this")
    parser.add_argument("--json", type=Path, help="write the figures there too")
    arguments = parser.parse_args()
    figures = []
    for figure in run(quick=arguments.quick, only=arguments.only):
        figures.append(figure)
        verdict = {True: "ok  ", False: "MISS", None: "    "}[figure.good]
        wanted = f"   wanted {figure.wanted}" if figure.wanted else ""
        peer = f"   beside {figure.peer}" if figure.peer else ""
        print(f"{verdict} {figure.topic}: {figure.what}: {figure.ours}{wanted}{peer}", flush=True)
    if arguments.json:
        arguments.json.write_text(json.dumps([asdict(f) for f in figures], indent=1) + "\n")
    return int(any(figure.good is False for figure in figures))


if __name__ == "__main__":
    sys.exit(main())
