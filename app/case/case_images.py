"""The ultrasound images of a case: at each time the newest one, or why none may be shown."""

from bisect import bisect_right
from typing import TYPE_CHECKING

import numpy as np

from app.case.images.bag_images import BagImages, recorded_depths
from app.case.images.current_image import CurrentImage, ImagePose
from app.case.images.image_sequence import ImageSequence
from app.case.images.probe_calibration import (
    IMAGE_FRAME,
    DepthCalibration,
    ImageDepths,
    read_image_calibration,
)
from app.case.manifest.images import ImageCalibrationEntry, ImagesEntry
from app.case.readers.recording_format import SideTopics, read_recording
from app.geometry import (
    NS_PER_MS,
    Freshness,
    FreshnessLimits,
    ImageCalibration,
    ImageSample,
    InputError,
    freshness_of,
)

if TYPE_CHECKING:
    from app.case.case import Case


class CaseImages:
    """The images of a case; made by `open_case_images`. Not thread-safe; `close` it.

    An image is current until it is older than ``stale_after_ns``.
    """

    def __init__(self, sequence: ImageSequence, depths: ImageDepths, stale_after_ns: int) -> None:
        self.sequence, self._depths = sequence, depths
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
        used = self._depths.at(self._stamps_ns[place])
        pose = self.sequence.pose(number, used.calibration, frame)
        return CurrentImage(number, pose, used.depth_mm)

    @property
    def size(self) -> tuple[int, int]:
        """Columns and rows of every image."""
        return self.sequence.size

    def image(self, number: int) -> ImageSample:
        """Read image ``number``."""
        return self.sequence.image(number)

    def close(self) -> None:
        """Close the file."""
        self.sequence.close()


def image_depths(case: "Case", entry: ImagesEntry) -> ImageDepths:
    """Read the calibrations of the probe that ``entry`` names; raises `InputError`."""
    found = (_calibration(case, entry, each) for each in entry.calibrations)
    return ImageDepths(tuple(found), entry.depth_mm)


def _calibration(case: "Case", entry: ImagesEntry, each: ImageCalibrationEntry) -> DepthCalibration:
    depth_mm = each.depth_mm
    key = "images.calibration" if depth_mm is None else f"images.calibrations, {depth_mm:g} mm"
    if each.path is not None:
        calibration = read_image_calibration(case.file(each.path, key), entry.probe)
    else:
        try:
            calibration = ImageCalibration(entry.probe, np.array(each.matrix), IMAGE_FRAME)
        except InputError as error:
            raise InputError(f"{case.manifest.file}: {key}: {error}") from error
    return DepthCalibration(depth_mm, calibration)


def stale_after_ns(case: "Case", entry: ImagesEntry) -> int:
    """Age up to which an image of ``case`` is current: its own limit, or that of the margins."""
    own = entry.stale_after_ns
    return case.manifest.margins.stale_after_ns if own is None else own


def open_case_images(case: "Case") -> CaseImages | BagImages | None:
    """Open the images of ``case``; None for a case without ``images``.

    Raises `InputError` for files that cannot be read, for a sequence in which no image has a time
    and a pose of the probe, and for a bag without an image.
    """
    entry = case.manifest.images
    if entry is None:
        return None
    if entry.topic is not None:
        return _bag_images(case, entry, entry.topic)
    path = case.recording_path if entry.path is None else case.file(entry.path, "images.path")
    if path is None:
        raise InputError(f"{case.manifest.file}: images.path is missing; expected a sequence")
    depths = image_depths(case, entry)
    sequence = ImageSequence(path, entry.orientation)
    try:
        _require_poses(sequence, entry.probe, case.manifest.file)
    except InputError:
        sequence.close()
        raise
    return CaseImages(sequence, depths, stale_after_ns(case, entry))


def _bag_images(case: "Case", entry: ImagesEntry, topic: str) -> BagImages:
    depths = image_depths(case, entry)
    if case.recording_path is None:
        raise InputError(f"{case.manifest.file}: images.topic is given without a recording")
    for chosen in recorded_depths(case.recording_path) if depths.depths_mm else ():
        depths.choose(chosen.depth_mm, chosen.from_ns)
    joints = SideTopics(None, 0)  # the poses alone, also before the joints' clock is estimated
    frames = read_recording(case.recording_path, _ignored, joints)
    samples = [sample for frame in frames for sample in frame.poses]
    if not any(entry.probe in (each.source, each.target) for each in samples):
        known = ", ".join(sorted({each.source for each in samples})) or "none"
        raise InputError(
            f"{case.manifest.file}: images.probe is {entry.probe!r}, which has no pose; expected "
            f"one of {known}"
        )
    return BagImages(
        case.recording_path,
        topic,
        entry.orientation or "MF",
        depths,
        samples,
        stale_after_ns=stale_after_ns(case, entry),
        max_gap_ns=case.manifest.margins.stale_after_ns,
    )


def _ignored(note: str) -> None:
    """Notes are those of the reading of the frames."""


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
