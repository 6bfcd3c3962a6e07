"""Rigid transforms with named frames: ``a_from_b @ b_from_c`` is ``a_from_c``."""

import math
import struct
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy  # loads `scipy.spatial` lazily, which takes 0.25 s
from numpy.typing import ArrayLike, NDArray

from app.geometry.errors import FrameError, TransformError
from app.geometry.frames import check_frame
from app.geometry.stamp import slot_setters

FloatArray = NDArray[np.float64]

ROTATION_TOLERANCE = 1e-3
"""Largest entry of ``R^T R - 1`` that is treated as rounding.

Trackers and configuration files print 4 to 7 digits, an error of 1e-4 at most. A scale of 0.1 %
(2e-3 here) or a shear is rejected."""

_EXACT = 1e-14

_NINE = struct.Struct("9d")


@dataclass(frozen=True, slots=True, eq=False)
class Transform:
    """``target_from_source``: maps coordinates in ``source`` to coordinates in ``target``.

    ``rotation`` is (3, 3), orthonormal with determinant +1; ``translation_mm`` is (3,), in mm in
    ``target``. Both are copied and read-only. A matrix within `ROTATION_TOLERANCE` is replaced by
    the nearest rotation. Raises `TransformError` for other matrices and non-finite numbers, and
    `FrameError` for invalid frame names.

    >>> import marginguard as mg
    >>> quarter_turn = [[0, -1, 0], [1, 0, 0], [0, 0, 1]]
    >>> sensor_from_tumor = mg.Transform("sensor", "tumor", quarter_turn, [0, 0, 30])
    >>> sensor_from_tumor.apply([10, 0, 0]).tolist()
    [0.0, 10.0, 30.0]
    >>> tracker_from_sensor = mg.Transform.identity("tracker", "sensor")
    >>> tracker_from_tumor = tracker_from_sensor @ sensor_from_tumor
    >>> tracker_from_tumor.target, tracker_from_tumor.source
    ('tracker', 'tumor')
    """

    target: str
    source: str
    rotation: FloatArray
    translation_mm: FloatArray

    def __post_init__(self) -> None:
        check_frame(self.target)
        check_frame(self.source)
        name = f"{self.target}_from_{self.source}"
        rotation = _checked(self.rotation, (3, 3), f"rotation of {name}")
        translation = _checked(self.translation_mm, (3,), f"translation_mm of {name}")
        object.__setattr__(self, "rotation", _read_only(_nearest_rotation(rotation, name)))
        object.__setattr__(self, "translation_mm", _read_only(translation))

    @classmethod
    def identity(cls, target: str, source: str) -> "Transform":
        """The identity between two frames."""
        return cls.unchecked(target, source, np.eye(3), np.zeros(3))

    @classmethod
    def unchecked(
        cls, target: str, source: str, rotation: FloatArray, translation_mm: FloatArray
    ) -> "Transform":
        """Construct from new arrays (3, 3) and (3,) without copying; only the names are checked.

        Both arrays become read-only. Use it only for results that are rotations by computation
        from finite numbers: a product of rotations, a rotation formula, an orthonormal basis. Each
        factor adds an error of about 1e-16, so a product of 10000 is far below
        `ROTATION_TOLERANCE`, and the check would take longer than the product. Measured, received
        and read data must go through the constructor.
        """
        return _unchecked(check_frame(target), check_frame(source), rotation, translation_mm)

    @classmethod
    def of_read_only(
        cls, target: str, source: str, rotation: FloatArray, translation_mm: FloatArray
    ) -> "Transform":
        """Construct like `unchecked`, from arrays that are read-only and names that are valid."""
        made = object.__new__(cls)
        _set_target(made, target)
        _set_source(made, source)
        _set_rotation(made, rotation)
        _set_translation(made, translation_mm)
        return made

    @classmethod
    def from_matrix(cls, matrix: ArrayLike, *, target: str, source: str) -> "Transform":
        """Construct from a homogeneous (4, 4) matrix in mm, or its 16 numbers in row order."""
        name = f"{target}_from_{source}"
        try:
            values = np.array(matrix, dtype=np.float64)
        except (TypeError, ValueError) as error:
            raise TransformError(
                f"matrix of {name} is {matrix!r}; expected an array of numbers"
            ) from error
        if values.shape == (16,):
            values = values.reshape(4, 4)
        values = _checked(values, (4, 4), f"matrix of {name}")
        x, y, z, one = values[3].tolist()
        if max(abs(x), abs(y), abs(z), abs(one - 1.0)) > 1e-9:
            raise TransformError(
                f"last row of the matrix of {name} is {values[3].tolist()}; expected 0 0 0 1"
            )
        return cls(target, source, values[:3, :3], values[:3, 3])

    @classmethod
    def from_quaternion(
        cls, xyzw: ArrayLike, translation_mm: ArrayLike, *, target: str, source: str
    ) -> "Transform":
        """Construct from a quaternion (x, y, z, w), as in ROS, and a translation in mm.

        The quaternion is normalised if its norm is within `ROTATION_TOLERANCE` of 1;
        `TransformError` otherwise.
        """
        name = f"{target}_from_{source}"
        what = f"quaternion of {name}"
        rotation = rotation_of_quaternion(*_checked(xyzw, (4,), what).tolist(), what=what)
        translation = _checked(translation_mm, (3,), f"translation_mm of {name}")
        return cls.unchecked(target, source, rotation, translation)

    @classmethod
    def from_rotation_vector(
        cls, rotation_vector: ArrayLike, translation_mm: ArrayLike, *, target: str, source: str
    ) -> "Transform":
        """Construct from an axis times an angle in rad, (3,), and a translation in mm."""
        vector = _checked(rotation_vector, (3,), f"rotation vector of {target}_from_{source}")
        rotation = scipy.spatial.transform.Rotation.from_rotvec(vector).as_matrix()
        return cls(target, source, rotation, np.asarray(translation_mm, dtype=np.float64))

    @property
    def matrix(self) -> FloatArray:
        """The homogeneous (4, 4) matrix, in mm; a new array."""
        matrix = np.eye(4)
        matrix[:3, :3] = self.rotation
        matrix[:3, 3] = self.translation_mm
        return matrix

    @property
    def quaternion_xyzw(self) -> FloatArray:
        """The rotation as (x, y, z, w) with w >= 0."""
        return np.array(quaternion_of_rotation(self.rotation))

    @property
    def rotation_vector(self) -> FloatArray:
        """The rotation as an axis times an angle in [0, pi] rad, (3,)."""
        return scipy.spatial.transform.Rotation.from_matrix(self.rotation).as_rotvec()

    def inverse(self) -> "Transform":
        """Return ``source_from_target``."""
        rotation = self.rotation.T.copy()
        return _unchecked(self.source, self.target, rotation, -rotation.dot(self.translation_mm))

    def __matmul__(self, other: "Transform") -> "Transform":
        if self.source != other.target:
            raise mismatched_frames((self.target, self.source), (other.target, other.source))
        return _unchecked(
            self.target,
            other.source,
            self.rotation.dot(other.rotation),
            self.rotation.dot(other.translation_mm) + self.translation_mm,
        )

    def apply(self, points_mm: ArrayLike) -> FloatArray:
        """Map points (3,) or (n, 3) in mm from ``source`` to ``target``."""
        return np.asarray(points_mm, dtype=np.float64) @ self.rotation.T + self.translation_mm

    def rotate(self, vectors: ArrayLike) -> FloatArray:
        """Map directions (3,) or (n, 3) from ``source`` to ``target``: rotation only."""
        return np.asarray(vectors, dtype=np.float64) @ self.rotation.T

    def is_same(self, other: "Transform") -> bool:
        """True for the same frames and the same numbers."""
        return (
            (self.target, self.source) == (other.target, other.source)
            and np.array_equal(self.rotation, other.rotation)
            and np.array_equal(self.translation_mm, other.translation_mm)
        )

    def angle_to(self, other: "Transform") -> float:
        """Angle in rad of the rotation between two transforms of the same frames."""
        self._check_same_frames(other)
        return rotation_angle(self.rotation.T.dot(other.rotation))

    def distance_mm_to(self, other: "Transform") -> float:
        """Distance in mm between the origins of two transforms of the same frames."""
        self._check_same_frames(other)
        return math.dist(self.translation_mm.tolist(), other.translation_mm.tolist())

    def interpolate(self, other: "Transform", fraction: float) -> "Transform":
        """Interpolate between self (0) and other (1).

        Linear in translation, shortest arc in rotation. Raises `TransformError` for a fraction
        outside [0, 1].
        """
        self._check_same_frames(other)
        if not 0.0 <= fraction <= 1.0:
            raise TransformError(f"fraction of an interpolation is {fraction}; expected 0 to 1")
        x, y, z, w = quaternion_of_rotation(self.rotation.T.dot(other.rotation))
        sine = math.sqrt(x * x + y * y + z * z)
        part = fraction * math.atan2(sine, w)  # of half the angle
        scale = math.sin(part) / sine if sine > 0.0 else 0.0
        turn = rotation_of_quaternion(scale * x, scale * y, scale * z, math.cos(part))
        rotation = self.rotation.dot(turn)
        step = other.translation_mm - self.translation_mm
        return _unchecked(self.target, self.source, rotation, self.translation_mm + fraction * step)

    def renamed(self, *, target: str | None = None, source: str | None = None) -> "Transform":
        """The same rotation and translation with other frame names."""
        return _unchecked(
            self.target if target is None else check_frame(target),
            self.source if source is None else check_frame(source),
            self.rotation,
            self.translation_mm,
        )

    def _check_same_frames(self, other: "Transform") -> None:
        if (self.target, self.source) != (other.target, other.source):
            raise FrameError(
                f"{self.target}_from_{self.source} and {other.target}_from_{other.source} "
                "have different frames; expected the same frames"
            )


def mismatched_frames(left: tuple[str, str], right: tuple[str, str]) -> FrameError:
    """The error of a product whose factors, each (target, source), have no frame in common."""
    (target, source), (other_target, other_source) = left, right
    return FrameError(
        f"{target}_from_{source} cannot be multiplied by {other_target}_from_{other_source}: "
        f"{source!r} is not {other_target!r}"
    )


def mean_transform(transforms: Sequence[Transform]) -> Transform:
    """Mean translation and mean rotation of n > 0 transforms between the same frames.

    The mean rotation minimises the sum of squared chordal distances (Hartley, Trumpf, Dai and Li,
    "Rotation averaging", 2013). Raises `TransformError` for an empty list and `FrameError` for
    different frames.
    """
    if not transforms:
        raise TransformError("0 transforms have no mean; expected at least 1")
    first = transforms[0]
    for other in transforms:
        first._check_same_frames(other)
    rotation = closest_rotation(np.mean([each.rotation for each in transforms], axis=0))
    translation = np.mean([each.translation_mm for each in transforms], axis=0)
    return Transform(first.target, first.source, rotation, translation)


def closest_rotation(matrix: FloatArray) -> FloatArray:
    """Return the rotation (3, 3) that differs least from ``matrix`` (3, 3), in the Frobenius norm.

    Kabsch 1976. Raises `TransformError` for numbers that are not finite.
    """
    left, _, right = np.linalg.svd(_checked(matrix, (3, 3), "matrix of a rotation"))
    if np.linalg.det(left @ right) < 0.0:  # that would be a reflection
        left[:, 2] = -left[:, 2]
    return np.asarray(left @ right, dtype=np.float64)


def rotation_of_quaternion(
    x: float, y: float, z: float, w: float, *, what: str = "quaternion"
) -> FloatArray:
    """Return the rotation matrix (3, 3), read-only, by the Euler-Rodrigues formula.

    The quaternion is normalised if its norm is within `ROTATION_TOLERANCE` of 1; `TransformError`
    otherwise, with the name ``what``. The formula is written out because every recorded pose is
    converted by it.
    """
    norm = math.hypot(x, y, z, w)  # unlike a sum of squares, does not overflow
    if not abs(norm - 1.0) <= ROTATION_TOLERANCE:
        raise TransformError(f"{what} has norm {norm:.6g}; expected 1 within {ROTATION_TOLERANCE}")
    x, y, z, w = x / norm, y / norm, z / norm, w / norm
    numbers = _NINE.pack(
        1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w),
        2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w),
        2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y),
    )  # fmt: skip
    return np.ndarray((3, 3), np.float64, numbers)


def quaternion_of_rotation(rotation: FloatArray) -> tuple[float, float, float, float]:
    """Return the quaternion (x, y, z, w) with w >= 0 of a rotation (3, 3).

    Its largest component is computed first, which avoids cancellation (Shepperd 1978). Loading
    scipy, which does the same, takes 0.2 s.
    """
    (a, b, c), (d, e, f), (g, h, i) = rotation.tolist()
    trace = a + e + i
    if trace >= max(a, e, i):
        x, y, z, w = h - f, c - g, d - b, 1.0 + trace
    elif a >= max(e, i):
        x, y, z, w = 1.0 - trace + 2.0 * a, b + d, c + g, h - f
    elif e >= i:
        x, y, z, w = b + d, 1.0 - trace + 2.0 * e, f + h, c - g
    else:
        x, y, z, w = c + g, f + h, 1.0 - trace + 2.0 * i, d - b
    norm = math.sqrt(x * x + y * y + z * z + w * w)
    if w < 0.0 or (w == 0.0 and (x, y, z) < (0.0, 0.0, 0.0)):
        norm = -norm
    return x / norm, y / norm, z / norm, w / norm


def rotation_angle(rotation: FloatArray) -> float:
    """Angle in rad of a rotation (3, 3), accurate near 0 and near pi."""
    (a, b, c), (d, e, f), (g, h, i) = rotation.tolist()
    sine = 0.5 * math.sqrt((h - f) ** 2 + (c - g) ** 2 + (d - b) ** 2)
    cosine = 0.5 * (a + e + i - 1.0)
    return math.atan2(sine, cosine)


def _checked(values: ArrayLike, shape: tuple[int, ...], what: str) -> FloatArray:
    try:
        array = np.array(values, dtype=np.float64, order="C")  # the layout of compiled code
    except (TypeError, ValueError) as error:
        raise TransformError(f"{what} is {values!r}; expected an array of numbers") from error
    if array.shape != shape:
        raise TransformError(f"{what} has shape {array.shape}; expected {shape}")
    # Python floats, as below: for arrays of this size NumPy calls take longer than the arithmetic.
    if not all(map(math.isfinite, array.ravel().tolist())):
        raise TransformError(f"{what} is not finite: {array.tolist()}; expected finite numbers")
    return array


def _nearest_rotation(rotation: FloatArray, name: str) -> FloatArray:
    (a, b, c), (d, e, f), (g, h, i) = rotation.tolist()
    deviation = max(
        abs(a * a + d * d + g * g - 1.0),
        abs(b * b + e * e + h * h - 1.0),
        abs(c * c + f * f + i * i - 1.0),
        abs(a * b + d * e + g * h),
        abs(a * c + d * f + g * i),
        abs(b * c + e * f + h * i),
    )
    if deviation > ROTATION_TOLERANCE:
        raise TransformError(
            f"rotation of {name} is not orthonormal: R^T R differs from 1 by {deviation:.3g}; "
            f"expected at most {ROTATION_TOLERANCE}"
        )
    if a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g) < 0.0:
        raise TransformError(f"rotation of {name} is a reflection; expected determinant +1")
    if deviation <= _EXACT:
        return rotation
    left, _, right = np.linalg.svd(rotation)
    return np.asarray(left @ right, dtype=np.float64)


def _read_only(array: FloatArray) -> FloatArray:
    array.setflags(write=False)
    return array


def _unchecked(
    target: str, source: str, rotation: FloatArray, translation_mm: FloatArray
) -> Transform:
    """Construct like `Transform.unchecked`, for frame names that have been checked.

    A session step calls this a dozen times: it sets slots directly and passes flags by position,
    which takes NumPy half the time (its stubs allow names only).
    """
    rotation.setflags(False)  # type: ignore[call-arg]
    translation_mm.setflags(False)  # type: ignore[call-arg]
    made = object.__new__(Transform)
    _set_target(made, target)
    _set_source(made, source)
    _set_rotation(made, rotation)
    _set_translation(made, translation_mm)
    return made


_set_target, _set_source, _set_rotation, _set_translation = slot_setters(Transform)
