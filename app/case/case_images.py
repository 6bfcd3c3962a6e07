"""The ultrasound images of a case, of a sequence or a bag: the newest, or why none is shown."""

from bisect import bisect_right
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from app.case.images.current_image import CurrentImage, ImagePose, PoseHistory
from app.case.images.image_layout import standard_image
from app.case.images.image_sequence import ImageSequence
from app.case.images.probe_calibration import (
    IMAGE_FRAME,
    DepthCalibration,
    ImageDepths,
    read_image_calibration,
)
from app.case.manifest.images import ImageCalibrationEntry, ImagesEntry
from app.case.messages.decoder import message_decoder
from app.case.messages.message_values import read_image_message
from app.case.messages.ros_messages import RANGE
from app.case.readers.recording_format import MessagePlace, SideTopics, read_recording
from app.case.readers.rosbag2.bag import mcap_parts
from app.case.readers.rosbag2.mcap_file import read_placed_message, read_placed_messages
from app.files.bounded_io import is_folder
from app.geometry import (
    NS_PER_MS,
    Freshness,
    FreshnessLimits,
    ImageCalibration,
    ImageSample,
    InputError,
    TrackedTransform,
    freshness_of,
)

if TYPE_CHECKING:
    from app.case.case import Case


@dataclass(frozen=True, slots=True)
class _Entry:
    """A good image: its stamp, and where its message is."""

    stamp_ns: int
    path: Path
    place: MessagePlace


def _age_problem(number: int, stamp_ns: int, now_ns: int, limits: FreshnessLimits) -> str:
    if freshness_of(stamp_ns, now_ns, limits) is Freshness.VALID:
        return ""
    return (
        f"image {number} is {(now_ns - stamp_ns) / NS_PER_MS:.0f} ms old; expected at most "
        f"{limits.stale_after_ns / NS_PER_MS:.0f} ms"
    )


class BagImages:
    """The images of ``topic`` in the MCAP file or rosbag2 folder ``path``, in the order of stamps.

    All are read once, to know their stamps; then one is in memory. Those that are refused
    (`read_image_message`, another size than the first) are left out.
    ``depths`` place them. ``poses`` are the tracker's samples; poses around an image are at most
    ``max_gap_ns`` apart. Raises `InputError` for a recording without a good image on ``topic``.
    """

    def __init__(
        self,
        path: Path,
        topic: str,
        orientation: str,
        depths: ImageDepths,
        poses: Iterable[TrackedTransform],
        *,
        stale_after_ns: int,
        max_gap_ns: int,
    ) -> None:
        self._topic, self._orientation, self._depths = topic, orientation, depths
        self._limits = FreshnessLimits(stale_after_ns)
        self._kind: tuple[tuple[int, ...], str] | None = None
        self._refused: list[str] = []
        entries = [entry for part in _parts(path) for entry in self._indexed(part)]
        if not entries or self._kind is None:
            reason = f": {self._refused[0]}" if self._refused else ""
            raise InputError(f"{path} has no image on {topic}{reason}; expected sensor_msgs/Image")
        self._entries: list[_Entry] = sorted(entries, key=lambda entry: entry.stamp_ns)
        self._stamps_ns: list[int] = [entry.stamp_ns for entry in self._entries]
        self._poses: PoseHistory = PoseHistory(max_gap_ns)
        self._poses.add(tuple(poses))
        self._last: ImageSample | None = None

    def __len__(self) -> int:
        return len(self._entries)

    @property
    def size(self) -> tuple[int, int]:
        """Columns and rows of every image."""
        shape = (0, 0) if self._kind is None else self._kind[0]
        return shape[1], shape[0]

    def at(self, now_ns: int, frame: str) -> CurrentImage:
        """The newest image at ``now_ns`` on the tracker's clock, placed in ``frame``."""
        number = bisect_right(self._stamps_ns, now_ns) - 1
        if number < 0:
            return CurrentImage(None, ImagePose(None, "no image yet"))
        stamp_ns = self._stamps_ns[number]
        if problem := _age_problem(number, stamp_ns, now_ns, self._limits):
            return CurrentImage(number, ImagePose(None, problem))
        found = self._poses.matrix(stamp_ns, frame, self._depths.probe)
        if isinstance(found, str):
            return CurrentImage(number, ImagePose(None, f"image {number}: {found}"))
        used = self._depths.at(stamp_ns)
        return CurrentImage(number, ImagePose(found @ used.calibration.matrix), used.depth_mm)

    def image(self, number: int) -> ImageSample:
        """Read image ``number``, from 0; the last one is kept."""
        if not 0 <= number < len(self):
            raise InputError(f"image {number} does not exist; expected 0 to {len(self) - 1}")
        if self._last is None or self._last.number != number:
            entry = self._entries[number]
            data = read_placed_message(entry.path, entry.place)
            self._last = standard_image(read_image_message(data, number), self._orientation)
        return self._last

    def close(self) -> None:
        """Release the last image; no file is open."""
        self._last = None

    def _indexed(self, part: Path) -> Iterable[_Entry]:
        for place, data in read_placed_messages(part, self._topic):
            try:
                image = standard_image(read_image_message(data, 0), self._orientation)
                pixels, stamp = image.pixels, image.stamp
                if pixels is None or stamp is None:
                    raise InputError("image has no pixels or no stamp; expected both")
                kind = pixels.shape, pixels.dtype.name
                self._kind = self._kind or kind
                if kind != self._kind:
                    raise InputError(
                        f"image has pixels {kind[0]} of {kind[1]}; expected {self._kind[0]} of "
                        f"{self._kind[1]}, as the first one"
                    )
            except InputError as error:
                self._refused.append(str(error))
                continue
            yield _Entry(stamp.ns, part, place)


def _parts(path: Path) -> list[Path]:
    """The MCAP files of ``path``; a bag in databases has none."""
    if not is_folder(path):
        return [path]
    parts = mcap_parts(path)
    if not parts:
        raise InputError(f"{path} has no .mcap file; expected images in a bag in MCAP")
    return parts


# Each is a ``sensor_msgs/Range``: ``range`` is the depth in m, ``header.stamp`` the time on the
# clock of the tracker after which it holds.

IMAGE_DEPTH_TOPIC = "/marginguard/image_depth"


@dataclass(frozen=True, slots=True)
class RecordedDepth:
    """``depth_mm`` holds for images that are stamped after ``from_ns``."""

    depth_mm: float
    from_ns: int


def recorded_depths(path: Path) -> Iterator[RecordedDepth]:
    """Yield the depths in the MCAP file or the folder ``path``, in the order of their recording.

    Raises `InputError` for a message that is no depth.
    """
    read = message_decoder(RANGE)
    for part in mcap_parts(path) if is_folder(path) else [path]:
        for _, data in read_placed_messages(part, IMAGE_DEPTH_TOPIC):
            values = read(data)
            yield RecordedDepth(1000.0 * values.range_m, values.stamp_ns)


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
        number, stamp_ns = self._numbers[place], self._stamps_ns[place]
        if problem := _age_problem(number, stamp_ns, now_ns, self._limits):
            return CurrentImage(number, ImagePose(None, problem))
        used = self._depths.at(stamp_ns)
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
