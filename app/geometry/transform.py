"""Rigid transforms that know their frames: ``a_from_b @ b_from_c`` is ``a_from_c``."""

import math
import struct
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy  # its parts are loaded when they are used: rotations take a quarter of a second
from numpy.typing import ArrayLike, NDArray

from app.geometry.errors import FrameError, TransformError
from app.geometry.frames import check_frame
from app.geometry.slots import setters

FloatArray = NDArray[np.float64]

ROTATION_TOLERANCE = 1e-3
"""Largest entry of ``R^T R - 1`` that is taken for rounding and projected away.

Trackers and configuration files print 4 to 7 digits, so a measured rotation is off by 1e-4 at
most; a scale of 0.1 % (2e-3 here) or a shear is no rounding and is refused."""

_EXACT = 1e-14

_NINE = struct.Struct("9d")


@dataclass(frozen=True, slots=True, eq=False)
class Transform:
    """``target_from_source``: maps coordinates in ``source`` to coordinates in ``target``.

    ``rotation`` is (3, 3), orthonormal with determinant +1; ``translation_mm`` is (3,), in mm in
    ``target``. Both are copied and read-only. A rotation within `ROTATION_TOLERANCE` is projected
    to the nearest rotation; anything else raises `TransformError`.
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
        """Two frames that coincide."""
        return cls.unchecked(target, source, np.eye(3), np.zeros(3))

    @classmethod
    def unchecked(
        cls, target: str, source: str, rotation: FloatArray, translation_mm: FloatArray
    ) -> "Transform":
        """From new arrays (3, 3) and (3,), which are taken over; the names alone are checked.

        For what is a rotation because of how it was made, out of finite numbers: a product of
        rotations, a formula of one, an orthonormal basis. It is off by some 1e-16 a factor, so a
        product of ten thousand is still a thousand million times better than `ROTATION_TOLERANCE`,
        and at 1 kHz the check would cost more than the product. Whatever was measured, read from a
        file or sent by somebody goes through the constructor.
        """
        return _unchecked(check_frame(target), check_frame(source), rotation, translation_mm)

    @classmethod
    def from_matrix(cls, matrix: ArrayLike, *, target: str, source: str) -> "Transform":
        """From a homogeneous (4, 4) matrix in mm, or its 16 numbers row by row."""
        name = f"{target}_from_{source}"
        try:
            values = np.array(matrix, dtype=np.float64)
        except (TypeError, ValueError) as error:
            raise TransformError(f"matrix of {name} is not made of numbers: {matrix!r}") from error
        if values.shape == (16,):
            values = values.reshape(4, 4)
        values = _checked(values, (4, 4), f"matrix of {name}")
        if not np.allclose(values[3], (0.0, 0.0, 0.0, 1.0), rtol=0.0, atol=1e-9):
            raise TransformError(
                f"last row of the matrix of {name} is {values[3].tolist()}: 0 0 0 1 wanted"
            )
        return cls(target, source, values[:3, :3], values[:3, 3])

    @classmethod
    def from_quaternion(
        cls, xyzw: ArrayLike, translation_mm: ArrayLike, *, target: str, source: str
    ) -> "Transform":
        """From a quaternion (x, y, z, w), as in ROS, and a translation in mm.

        The quaternion is normalised when its norm is within `ROTATION_TOLERANCE` of 1.
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
        """From an axis times an angle in radians, (3,), and a translation in mm."""
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
        """The rotation as (x, y, z, w), w not negative."""
        return scipy.spatial.transform.Rotation.from_matrix(self.rotation).as_quat(canonical=True)

    @property
    def rotation_vector(self) -> FloatArray:
        """The rotation as an axis times an angle in [0, pi]."""
        return scipy.spatial.transform.Rotation.from_matrix(self.rotation).as_rotvec()

    def inverse(self) -> "Transform":
        """``source_from_target``."""
        rotation = self.rotation.T.copy()
        return _unchecked(self.source, self.target, rotation, -rotation.dot(self.translation_mm))

    def __matmul__(self, other: "Transform") -> "Transform":
        if self.source != other.target:
            raise FrameError(
                f"{self.target}_from_{self.source} cannot be followed by "
                f"{other.target}_from_{other.source}: {self.source!r} is not {other.target!r}"
            )
        return _unchecked(
            self.target,
            other.source,
            self.rotation.dot(other.rotation),
            self.rotation.dot(other.translation_mm) + self.translation_mm,
        )

    def apply(self, points_mm: ArrayLike) -> FloatArray:
        """Points (3,) or (n, 3) in ``source``, in mm, to coordinates in ``target``."""
        return np.asarray(points_mm, dtype=np.float64) @ self.rotation.T + self.translation_mm

    def rotate(self, vectors: ArrayLike) -> FloatArray:
        """Directions (3,) or (n, 3): rotated, not moved."""
        return np.asarray(vectors, dtype=np.float64) @ self.rotation.T

    def angle_to(self, other: "Transform") -> float:
        """The angle in radians of the rotation between two transforms of the same frames."""
        self._check_same_frames(other)
        return rotation_angle(self.rotation.T.dot(other.rotation))

    def distance_mm_to(self, other: "Transform") -> float:
        """The distance in mm between the origins of two transforms of the same frames."""
        self._check_same_frames(other)
        return math.dist(self.translation_mm.tolist(), other.translation_mm.tolist())

    def interpolate(self, other: "Transform", fraction: float) -> "Transform":
        """Between self (0) and other (1): linear in translation, shortest arc in rotation."""
        self._check_same_frames(other)
        if not 0.0 <= fraction <= 1.0:
            raise TransformError(f"fraction {fraction} of an interpolation is not within 0 and 1")
        turn = scipy.spatial.transform.Rotation.from_matrix(
            self.rotation.T @ other.rotation
        ).as_rotvec()
        rotation = (
            self.rotation
            @ scipy.spatial.transform.Rotation.from_rotvec(fraction * turn).as_matrix()
        )
        step = other.translation_mm - self.translation_mm
        return _unchecked(self.target, self.source, rotation, self.translation_mm + fraction * step)

    def renamed(self, *, target: str | None = None, source: str | None = None) -> "Transform":
        """The same numbers between frames of other names."""
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
                "are between different frames"
            )


def mean_transform(transforms: Sequence[Transform]) -> Transform:
    """The mean of n > 0 poses between the same frames: of positions, and of rotations.

    The mean rotation has the least squared chordal distance to all (Hartley, Trumpf, Dai and Li,
    "Rotation averaging", 2013).
    """
    if not transforms:
        raise TransformError("0 transforms have no mean: at least 1 wanted")
    first = transforms[0]
    for other in transforms:
        first._check_same_frames(other)
    rotation = scipy.spatial.transform.Rotation.from_matrix(
        np.stack([each.rotation for each in transforms])
    ).mean()
    translation = np.mean([each.translation_mm for each in transforms], axis=0)
    return Transform(first.target, first.source, rotation.as_matrix(), translation)


def rotation_of_quaternion(
    x: float, y: float, z: float, w: float, *, what: str = "quaternion"
) -> FloatArray:
    """A new array (3, 3), read-only, by the Euler-Rodrigues formula.

    ``what`` is normalised when its norm is within `ROTATION_TOLERANCE` of 1; `TransformError`
    otherwise. Recordings are read through this, so it is written out.
    """
    norm = math.hypot(x, y, z, w)  # a square would overflow where this does not
    if not abs(norm - 1.0) <= ROTATION_TOLERANCE:
        raise TransformError(f"{what} has norm {norm:.6g}: 1 within {ROTATION_TOLERANCE} wanted")
    x, y, z, w = x / norm, y / norm, z / norm, w / norm
    numbers = _NINE.pack(
        1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w),
        2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w),
        2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y),
    )  # fmt: skip
    return np.ndarray((3, 3), np.float64, numbers)


def rotation_angle(rotation: FloatArray) -> float:
    """The angle in radians of a (3, 3) rotation, exact near 0 and near pi alike."""
    (a, b, c), (d, e, f), (g, h, i) = rotation.tolist()
    sine = 0.5 * math.sqrt((h - f) ** 2 + (c - g) ** 2 + (d - b) ** 2)
    cosine = 0.5 * (a + e + i - 1.0)
    return math.atan2(sine, cosine)


def _checked(values: ArrayLike, shape: tuple[int, ...], what: str) -> FloatArray:
    try:
        array = np.array(values, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise TransformError(f"{what} is not made of numbers: {values!r}") from error
    if array.shape != shape:
        raise TransformError(f"{what} has shape {array.shape}: {shape} wanted")
    # In plain numbers, as below: arrays this small cost more to handle than to compute.
    if not all(map(math.isfinite, array.ravel().tolist())):
        raise TransformError(f"{what} is not finite: {array.tolist()}")
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
            f"rotation of {name} is not orthonormal: R^T R is off by {deviation:.3g}, "
            f"at most {ROTATION_TOLERANCE} allowed"
        )
    if a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g) < 0.0:
        raise TransformError(f"rotation of {name} is a reflection: determinant +1 wanted")
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
    """As `Transform.unchecked`, with names that were checked before.

    A step of a session makes a dozen: so it is written out, and flags are given by place, which
    NumPy takes in half the time, though its stubs want names.
    """
    rotation.setflags(False)  # type: ignore[call-arg]
    translation_mm.setflags(False)  # type: ignore[call-arg]
    transform = object.__new__(Transform)
    _set_target(transform, target)
    _set_source(transform, source)
    _set_rotation(transform, rotation)
    _set_translation(transform, translation_mm)
    return transform


_set_target, _set_source, _set_rotation, _set_translation = setters(Transform)
