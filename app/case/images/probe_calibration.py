"""The calibration of a probe that holds for an image, by the imaging depth at its time."""

from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from app.files.plus_config import read_plus_config
from app.files.transforms import read_affine
from app.geometry import ImageCalibration, InputError

_SAME_MM = 0.01
_SAME_AS_FIRST = 1e-3
"""Relative: the vectors of a message have single precision and are turned by a pose."""

_SAME_AS_CALIBRATED = 0.02
"""Relative: a calibration measures the size of a pixel, the device states it."""


@dataclass(frozen=True, slots=True, eq=False)
class DepthCalibration:
    """The calibration at an imaging depth; ``depth_mm`` None: of a probe with one depth."""

    depth_mm: float | None
    calibration: ImageCalibration


class ImageDepths:
    """Calibrations by depth, and which one holds at a time. Not thread-safe.

    ``calibrations`` are of one probe. ``depth_mm`` is the depth in use at the start. A depth that
    is chosen holds for images that are stamped later. Raises `InputError` for a depth that is not
    listed.
    """

    def __init__(
        self, calibrations: Sequence[DepthCalibration], depth_mm: float | None = None
    ) -> None:
        self._calibrations = tuple(calibrations)
        self._from_ns: list[int] = []
        self._chosen = [self._listed(depth_mm)]
        self._first_mm: tuple[float, float] | None = None

    @classmethod
    def one(cls, calibration: ImageCalibration) -> "ImageDepths":
        """A probe with one depth."""
        return cls((DepthCalibration(None, calibration),))

    @property
    def probe(self) -> str:
        """The tracked frame of the probe."""
        return self._calibrations[0].calibration.probe

    @property
    def calibrations(self) -> tuple[DepthCalibration, ...]:
        """The calibrations, as given."""
        return self._calibrations

    @property
    def depths_mm(self) -> tuple[float, ...]:
        """The listed depths, ascending; none for a probe with one depth."""
        return tuple(sorted(c.depth_mm for c in self._calibrations if c.depth_mm is not None))

    @property
    def depth_mm(self) -> float | None:
        """The depth that was chosen last."""
        return self._chosen[-1].depth_mm

    def choose(self, depth_mm: float, from_ns: int | None) -> None:
        """Use ``depth_mm`` for images stamped after ``from_ns``; None: for all that come.

        Choices are made in the order of their times.
        """
        chosen = self._listed(depth_mm)
        if from_ns is None:
            self._from_ns, self._chosen = [], [chosen]
            return
        while self._from_ns and self._from_ns[-1] >= from_ns:
            self._from_ns.pop()
            self._chosen.pop()
        self._from_ns.append(from_ns)
        self._chosen.append(chosen)

    def forget_times(self) -> None:
        """Use the depth that was chosen last for all images, as after the clock was set back."""
        self._from_ns, self._chosen = [], [self._chosen[-1]]

    def at(self, stamp_ns: int) -> DepthCalibration:
        """The calibration of an image that is stamped ``stamp_ns``."""
        return self._chosen[bisect_left(self._from_ns, stamp_ns)]

    def check(self, stamp_ns: int, pixel_mm: tuple[float, float] | None) -> None:
        """Raise `InputError` for an image whose stated size of a pixel is that of another depth.

        Several depths: the depth in use has to be the one whose pixels are nearest, within 2 %.
        One depth: all images have pixels as large as the first. None: nothing is stated.
        """
        if pixel_mm is None:
            return
        if not self.depths_mm:
            self._first_mm = self._first_mm or pixel_mm
            if _difference(pixel_mm, self._first_mm) > _SAME_AS_FIRST:
                raise InputError(
                    f"image has pixels of {_text(pixel_mm)}; expected {_text(self._first_mm)}, as "
                    "the first one of the session: the calibration holds for one depth"
                )
            return
        used = self.at(stamp_ns)
        away = {
            each: _difference(pixel_mm, each.calibration.pixel_mm) for each in self._calibrations
        }
        least = min(away.values())
        if least > _SAME_AS_CALIBRATED:
            raise InputError(
                f"image has pixels of {_text(pixel_mm)}; expected those of a listed depth: "
                + ", ".join(map(_named, self._calibrations))
            )
        if away[used] > least:
            nearest = next(each for each, value in away.items() if value == least)
            raise InputError(
                f"image has pixels of {_text(pixel_mm)}, those of depth {nearest.depth_mm:g} mm; "
                f"expected those of {_named(used)}, which is in use: choose depth "
                f"{nearest.depth_mm:g} mm"
            )

    def _listed(self, depth_mm: float | None) -> DepthCalibration:
        for each in self._calibrations:
            if each.depth_mm is None or depth_mm is None:
                if each.depth_mm is depth_mm:
                    return each
            elif abs(each.depth_mm - depth_mm) < _SAME_MM:
                return each
        given = "none" if depth_mm is None else f"{depth_mm:g} mm"
        listed = ", ".join(f"{each:g}" for each in self.depths_mm) or "none: one calibration"
        raise InputError(f"depth of the images: {given}; expected one of {listed}")


def _difference(one: tuple[float, float], other: tuple[float, float]) -> float:
    """The larger relative difference of width and height."""
    return float(np.max(np.abs(np.divide(one, other) - 1.0)))


def _text(pixel_mm: tuple[float, float]) -> str:
    return f"{pixel_mm[0]:.4g} x {pixel_mm[1]:.4g} mm"


def _named(each: DepthCalibration) -> str:
    return f"depth {each.depth_mm:g} mm ({_text(each.calibration.pixel_mm)})"


IMAGE_FRAME = "image"


def read_image_calibration(path: Path, probe: str) -> ImageCalibration:
    """Read ``ImageToProbe`` for the tracked frame ``probe`` from the file at ``path``.

    A ``.xml`` is a PLUS configuration; others are files as for a rigid transform (ITK, 16 numbers,
    YAML), whose matrix may be scaled here. Raises `InputError` for a file without it, and for a
    matrix that is no calibration.
    """
    if path.suffix.lower() == ".xml":
        matrix = read_plus_config(path).affine(probe, IMAGE_FRAME)
    else:
        matrix = read_affine(path, target=probe, source=IMAGE_FRAME)
    try:
        return ImageCalibration(probe, matrix, IMAGE_FRAME)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
