"""Lists of poses and sampled signals: selection, validation, covariance of a fit to them.

Neighbouring poses of a tracker have similar errors, so n poses tell less than n independent ones.
The covariance is that of generalised estimating equations (Liang and Zeger, "Longitudinal data
analysis using generalized linear models", 1986): ``A^-1 (sum_ij r_ij J_i^T S J_j) A^-1`` with
``A = sum_i J_i^T J_i``, the correlation ``r_ij`` that `app.geometry.correlated_noise` finds in the
residuals, and their covariance ``S``, which may differ by direction.
"""

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy  # loads `scipy.spatial` lazily, which takes 0.2 s
from numpy.typing import NDArray

from app.geometry import (
    FloatArray,
    FrameError,
    StampError,
    TrackedTransform,
    TrackingStatus,
    Transform,
)
from app.geometry.correlated_noise import MAX_SAMPLES, estimate_noise
from app.registration.input_checks import (
    DegenerateMotionError,
    NotFiniteError,
    NoValidSamplesError,
    ShapeError,
    TooFewError,
    UnequalCountsError,
    as_floats,
    check_positive,
)

MAX_COMPARED = 150
"""Maximum number of poses, evenly spaced in a list, that are compared in pairs."""

SAME_POSE_RAD = 1e-6
SAME_POSE_MM = 1e-3

MIN_TURN_RAD = math.radians(15.0)
"""Minimum of the largest rotation between two poses; below it nothing is computed."""


@dataclass(frozen=True, slots=True, eq=False)
class PoseStack:
    """Poses ``target_from_source`` as arrays: rotations (n, 3, 3), translations (n, 3) in mm."""

    target: str
    source: str
    rotations: FloatArray
    translations_mm: FloatArray

    @classmethod
    def from_poses(cls, poses: Sequence[Transform], what: str, *, min_count: int) -> "PoseStack":
        """Stack at least ``min_count`` poses between the same two frames.

        Raises `TooFewError`, `FrameError`, or `DegenerateMotionError` if all are the same pose.
        """
        if len(poses) < min_count:
            raise TooFewError(f"{len(poses)} poses for {what}; expected at least {min_count}")
        names = Counter((pose.target, pose.source) for pose in poses)
        if len(names) > 1:
            given = ", ".join(f"{target}_from_{source}" for target, source in names)
            raise FrameError(
                f"poses for {what} have different frames: {given}; expected the same frames"
            )
        rotations = np.stack([pose.rotation for pose in poses])
        translations = np.stack([pose.translation_mm for pose in poses])
        turn = np.abs(rotations - rotations[0]).max()
        shift = np.abs(translations - translations[0]).max()
        if turn < SAME_POSE_RAD and shift < SAME_POSE_MM:
            raise DegenerateMotionError(
                f"the {len(poses)} poses for {what} are one pose repeated; expected a difference "
                f"of at least {SAME_POSE_MM:g} mm or {SAME_POSE_RAD:g} rad"
            )
        return cls(poses[0].target, poses[0].source, rotations, translations)

    def select(self, mask: NDArray[np.bool_]) -> "PoseStack":
        """Return the poses of a mask (n,)."""
        return PoseStack(self.target, self.source, self.rotations[mask], self.translations_mm[mask])

    def relative_rotations(self, what: str) -> FloatArray:
        """Rotation vectors (m, 3) in rad, in the source frame, between pairs of poses of ``what``.

        Raises `DegenerateMotionError` if the largest is below `MIN_TURN_RAD`.
        """
        compared = np.unique(
            np.linspace(0, len(self.rotations) - 1, MAX_COMPARED).round().astype(int)
        )
        first, second = np.triu_indices(len(compared), k=1)
        rotations = self.rotations[compared]
        relative = np.swapaxes(rotations[first], 1, 2) @ rotations[second]
        turns = np.asarray(scipy.spatial.transform.Rotation.from_matrix(relative).as_rotvec())
        largest = float(np.linalg.norm(turns, axis=1).max())
        if largest < MIN_TURN_RAD:
            raise DegenerateMotionError(
                f"the poses of {what} rotate by at most {math.degrees(largest):.3g} degrees; "
                f"expected at least {math.degrees(MIN_TURN_RAD):g}"
            )
        return turns


def usable_poses(samples: Sequence[TrackedTransform]) -> tuple[Transform, ...]:
    """Return the transforms of the samples with status OK.

    Raises `NoValidSamplesError` if there is none.
    """
    poses = tuple(sample.transform for sample in samples if sample.transform is not None)
    if not poses:
        counts = Counter(sample.status for sample in samples)
        found = ", ".join(
            f"{count} {TrackingStatus(status).name}" for status, count in counts.items()
        )
        raise NoValidSamplesError(
            f"0 of {len(samples)} samples are OK ({found or 'none given'}); expected at least 1"
        )
    return poses


def select_poses(
    poses: Sequence[Transform],
    *,
    min_distance_mm: float = 3.0,
    min_angle_rad: float = np.radians(5.0),
) -> tuple[int, ...]:
    """Return indices of poses that differ from the last selected pose by both minima.

    Successive samples of slow motion have correlated errors and add little information. The first
    pose is always selected. Raises `TooFewError` for an empty list.
    """
    if not poses:
        raise TooFewError("0 poses to select from; expected at least 1")
    selected = [0]
    for index, pose in enumerate(poses[1:], start=1):
        last = poses[selected[-1]]
        if pose.distance_mm_to(last) >= min_distance_mm and pose.angle_to(last) >= min_angle_rad:
            selected.append(index)
    return tuple(selected)


@dataclass(frozen=True, slots=True)
class PoseNoise:
    """Standard deviation per axis of the rotation and the position of a measured pose.

    A 3-D root mean square is this times the square root of 3.
    """

    rotation_rad: float
    translation_mm: float

    def __post_init__(self) -> None:
        check_positive(self.rotation_rad, "rotation_rad of the pose noise")
        check_positive(self.translation_mm, "translation_mm of the pose noise")

    @classmethod
    def from_rms(cls, *, rotation_deg: float, translation_mm: float) -> "PoseNoise":
        """Construct from 3-D root mean squares, as in specifications of trackers."""
        return cls(math.radians(rotation_deg) / math.sqrt(3.0), translation_mm / math.sqrt(3.0))

    @property
    def sigmas(self) -> FloatArray:
        """Standard deviations (6,): three in rad, three in mm."""
        return np.repeat([self.rotation_rad, self.translation_mm], 3)


@dataclass(frozen=True, slots=True, eq=False)
class TimedSignal:
    """``values`` (n, d) at increasing ``times_ns`` (n,) on ``clock``.

    Values (n,) become (n, 1). Arrays are copied and read-only. Raises `ShapeError`,
    `UnequalCountsError` or `NotFiniteError`.
    """

    times_ns: NDArray[np.int64]
    values: FloatArray
    clock: str

    def __post_init__(self) -> None:
        times = np.array(self.times_ns)
        values = as_floats(self.values, f"values of signal {self.clock!r}")
        if values.ndim == 1:
            values = values[:, None]
        if times.dtype.kind not in "iu" or times.ndim != 1:
            raise ShapeError(
                f"times of signal {self.clock!r} are {times.dtype} of shape {times.shape}; "
                "expected integer ns of shape (n,)"
            )
        if values.ndim != 2 or len(values) != len(times):
            raise UnequalCountsError(
                f"signal {self.clock!r} has {len(times)} times and values of shape {values.shape}; "
                "expected one value per time"
            )
        finite = np.isfinite(values).all(axis=1)
        if not finite.all():
            first = int(np.argmin(finite))
            raise NotFiniteError(
                f"value {first} of signal {self.clock!r} is {values[first].tolist()}; "
                "expected finite numbers"
            )
        if np.any(np.diff(times) <= 0):
            late = int(np.argmin(np.diff(times))) + 1
            raise ShapeError(
                f"time {late} of signal {self.clock!r} is not after the previous one; "
                "expected increasing times"
            )
        times = times.astype(np.int64)
        times.flags.writeable = False
        values.flags.writeable = False
        object.__setattr__(self, "times_ns", times)
        object.__setattr__(self, "values", values)

    @classmethod
    def from_positions(cls, samples: Sequence[TrackedTransform]) -> "TimedSignal":
        """Positions (n, 3) in mm of the source frame at the OK samples of a recording."""
        return cls._from_samples(samples, rotations=False)

    @classmethod
    def from_poses(cls, samples: Sequence[TrackedTransform]) -> "TimedSignal":
        """Rotation matrices and positions (n, 12) of the source frame at the OK samples.

        The position of a point fixed to the source frame, in a frame fixed to the target frame, is
        a linear function of these 12 numbers. So robot and sensor poses can be aligned in time
        before their registration is known.
        """
        return cls._from_samples(samples, rotations=True)

    @classmethod
    def _from_samples(
        cls, samples: Sequence[TrackedTransform], *, rotations: bool
    ) -> "TimedSignal":
        poses = usable_poses(samples)
        stamps = [sample.stamp for sample in samples if sample.transform is not None]
        clocks = {stamp.clock for stamp in stamps}
        if len(clocks) > 1:
            raise StampError(
                f"samples of one signal are on several clocks: {sorted(clocks)}; expected one clock"
            )
        rows = [
            np.concatenate([pose.rotation.ravel(), pose.translation_mm])
            if rotations
            else pose.translation_mm
            for pose in poses
        ]
        return cls(
            np.array([stamp.ns for stamp in stamps], dtype=np.int64),
            np.stack(rows),
            stamps[0].clock,
        )


_ROWS = 500
"""Poses whose correlations with all others are computed at a time."""


def fit_covariance(
    residuals: FloatArray, jacobian: FloatArray, order: NDArray[np.intp]
) -> FloatArray:
    """Covariance (p, p) of the parameters of a fit.

    ``residuals`` (n, a) and their Jacobian (n, a, p) are in standard deviations; ``order`` (n,)
    are the increasing indices of the poses, which are taken as evenly spaced in time.
    """
    count, axes, parameters = jacobian.shape
    times = order.astype(np.float64)
    length = min(count, MAX_SAMPLES)
    starts = range(0, count - length + 1, max(1, length // 2))
    variance, correlation, _ = estimate_noise(
        np.array([times[start : start + length] for start in starts for _ in range(axes)]),
        np.array([residuals[start : start + length, k] for start in starts for k in range(axes)]),
        degree=0,
        overlap=1.0 if len(starts) == 1 else 0.6,
        longest=count / (2.0 * math.pi),
    )
    # The means that `estimate_noise` removes are some of the parameters.
    variance *= count * axes / max(count * axes - (parameters - axes), 1)
    scatter = residuals.T @ residuals
    scatter *= variance * axes / max(float(np.trace(scatter)), 1e-300)
    rows = np.einsum("ab,nap->nbp", np.linalg.cholesky(scatter + 1e-12 * np.eye(axes)), jacobian)
    middle = np.zeros((parameters, parameters))
    for first in range(0, count, _ROWS):
        part = slice(first, first + _ROWS)
        related = np.tensordot(correlation.matrix(times[part], times), rows, axes=1)
        middle += np.einsum("nap,naq->pq", rows[part], related)
    flat = jacobian.reshape(-1, parameters)
    inverse = np.linalg.inv(flat.T @ flat)
    return np.asarray(inverse @ (0.5 * (middle + middle.T)) @ inverse)
