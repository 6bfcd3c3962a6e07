"""The ultrasound images of a case: at each time the newest one, or why none may be shown."""

from bisect import bisect_right
from dataclasses import dataclass
from typing import TYPE_CHECKING

from app.case.images.calibration import read_image_calibration
from app.case.images.sequence import ImagePose, ImageSequence
from app.geometry import (
    NS_PER_MS,
    Freshness,
    FreshnessLimits,
    ImageCalibration,
    InputError,
    freshness_of,
)

if TYPE_CHECKING:
    from app.case.case import Case


@dataclass(frozen=True, slots=True, eq=False)
class CurrentImage:
    """The newest image at a time. It may be shown exactly if ``pose`` has a matrix.

    ``number``: None before the first image.
    """

    number: int | None
    pose: ImagePose


class CaseImages:
    """The images of a case; made by `open_case_images`. Not thread-safe; `close` it.

    An image is current until it is older than ``stale_after_ns``.
    """

    def __init__(
        self, sequence: ImageSequence, calibration: ImageCalibration, stale_after_ns: int
    ) -> None:
        self.sequence, self.calibration = sequence, calibration
        self._limits = FreshnessLimits(stale_after_ns)
        timed = sorted(
            (entry.stamp.ns, number)
            for number, entry in enumerate(sequence.header.entries)
            if entry.stamp is not None
        )
        self._stamps_ns = [stamp_ns for stamp_ns, _ in timed]
        self._numbers = [number for _, number in timed]

    def at(self, now_ns: int, frame: str) -> CurrentImage:
        """The newest image at ``now_ns`` on the tracker's clock, placed in ``frame``.

        Without a matrix if it is older than allowed, marked invalid, or has no pose of its own.
        """
        place = bisect_right(self._stamps_ns, now_ns) - 1
        if place < 0:
            return CurrentImage(None, ImagePose(None, "no image yet"))
        number, age_ns = self._numbers[place], now_ns - self._stamps_ns[place]
        if freshness_of(self._stamps_ns[place], now_ns, self._limits) is not Freshness.VALID:
            problem = (
                f"image {number} is {age_ns / NS_PER_MS:.0f} ms old; expected at most "
                f"{self._limits.stale_after_ns / NS_PER_MS:.0f} ms"
            )
            return CurrentImage(number, ImagePose(None, problem))
        return CurrentImage(number, self.sequence.pose(number, self.calibration, frame))

    def close(self) -> None:
        """Close the file."""
        self.sequence.close()


def open_case_images(case: "Case") -> CaseImages | None:
    """Open the images of ``case``; None for a case without ``images``.

    Raises `InputError` for files that cannot be read, and for a sequence in which no image has a
    time and a pose of the probe.
    """
    entry = case.manifest.images
    if entry is None:
        return None
    path = case.recording_path if entry.path is None else case.file(entry.path, "images.path")
    if path is None:
        raise InputError(f"{case.manifest.file}: images.path is missing; expected a sequence")
    calibration = read_image_calibration(
        case.file(entry.calibration, "images.calibration"), entry.probe
    )
    sequence = ImageSequence(path, entry.orientation)
    try:
        _require_poses(sequence, entry.probe, case.manifest.file)
    except InputError:
        sequence.close()
        raise
    stale_ns = entry.stale_after_ns
    if stale_ns is None:
        stale_ns = case.manifest.margins.stale_after_ns
    return CaseImages(sequence, calibration, stale_ns)


def _require_poses(sequence: ImageSequence, probe: str, file: str) -> None:
    """Raise `InputError` unless an image has a time and a pose of ``probe``."""
    frames: set[str] = set()
    for entry in sequence.header.entries:
        if entry.stamp is not None:
            frames |= {frame for edge in entry.poses for frame in edge}
    if probe not in frames:
        known = ", ".join(sorted(frames)) or "none"
        raise InputError(
            f"{file}: images.probe is {probe!r}: no image with a time has its pose; expected one "
            f"of {known}"
        )
