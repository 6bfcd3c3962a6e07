"""Images of a live session: the newest one that has a pose at its own stamp."""

import threading
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

from app.case import CurrentImage, DepthCalibration, ImageDepths, ImagePose, PoseHistory
from app.geometry import (
    NS_PER_MS,
    NS_PER_S,
    FloatArray,
    Freshness,
    FreshnessLimits,
    ImageSample,
    ImageStatus,
    InputError,
    Pixels,
    Stamp,
    TrackedTransform,
    freshness_of,
)

_HELD = 8
"""Images in memory: those that wait for a pose, and those that a page may still request."""

_KEEP_NS = 2 * NS_PER_S
_JUMP_NS = NS_PER_S // 2
"""An image older by this than the last one means that the clock was set back."""


@dataclass(slots=True)
class _Held:
    """A received image; ``place``: its matrix in the frame ``frame``, once known.

    ``depth`` is that at its stamp: it does not change when another depth is chosen.
    """

    image: ImageSample
    stamp_ns: int
    depth: DepthCalibration
    frame: str = ""
    place: FloatArray | None = None


class LiveImages:
    """Takes images and poses as they arrive, from any thread, and finds the one to be shown.

    An image is placed by the poses at its own stamp (`PoseHistory`): it waits until they have come,
    and the one before it is shown meanwhile. It may be shown while it differs from the moment that
    is shown by at most ``stale_after_ns``. Poses around an image are at most ``max_gap_ns`` apart.
    None may be shown while the last one was refused; the pose of `at` then has the problem.
    """

    def __init__(self, depths: ImageDepths, *, stale_after_ns: int, max_gap_ns: int) -> None:
        self._depths = depths
        self._newest_pose_ns: int | None = None
        self._limits = FreshnessLimits(stale_after_ns, future_tolerance_ns=stale_after_ns)
        self._poses = PoseHistory(max_gap_ns, _KEEP_NS)
        self._held: deque[_Held] = deque(maxlen=_HELD)
        self._kind: tuple[tuple[int, ...], str] | None = None
        self._problem = ""
        self._number = 0
        self._lock = threading.Lock()

    @property
    def size(self) -> tuple[int, int] | None:
        """Columns and rows of every image; None before the first one."""
        return None if self._kind is None else (self._kind[0][1], self._kind[0][0])

    def add_poses(self, samples: Sequence[TrackedTransform]) -> None:
        """Add samples of the tracker."""
        with self._lock:
            self._poses.add(samples)
            if not samples:
                return
            newest_ns = max(sample.stamp.ns for sample in samples)
            last_ns = self._newest_pose_ns
            if last_ns is not None and newest_ns < last_ns - _JUMP_NS:
                self._depths.forget_times()
                self._newest_pose_ns = newest_ns
            else:
                self._newest_pose_ns = newest_ns if last_ns is None else max(last_ns, newest_ns)

    def choose_depth(self, depth_mm: float) -> None:
        """Place images by the calibration of ``depth_mm`` that are stamped after the present.

        The present is the newest stamp of an image or a pose. Raises `InputError` for a depth that
        is not listed.
        """
        with self._lock:
            known = [held.stamp_ns for held in list(self._held)[-1:]]
            if self._newest_pose_ns is not None:
                known.append(self._newest_pose_ns)
            from_ns = max(known, default=None)
            self._depths.choose(depth_mm, from_ns)
            self._problem = ""

    def add(self, image: ImageSample) -> None:
        """Add the next image; one without a stamp, or of another size than the first, is refused.

        So is one whose stated size of a pixel is not that of the depth in use. An image whose stamp
        is not after the last one's is dropped.
        """
        pixels, stamp = image.pixels, image.stamp
        if pixels is None or stamp is None:
            self.refuse("image has no pixels or no stamp; expected both")
            return
        kind = pixels.shape, pixels.dtype.name
        if self._kind is not None and kind != self._kind:
            self.refuse(
                f"image has pixels {kind[0]} of {kind[1]}; expected {self._kind[0]} of "
                f"{self._kind[1]}, as the first one of the session"
            )
            return
        try:
            with self._lock:
                self._add(image, kind, pixels, stamp.ns)
        except InputError as error:
            self.refuse(str(error))

    def refuse(self, problem: str) -> None:
        """Show no image until a good one arrives, with the reason ``problem``."""
        with self._lock:
            self._problem = problem

    def at(self, now_ns: int, frame: str) -> CurrentImage:
        """The newest image at ``now_ns`` on the tracker's clock, placed in ``frame``."""
        with self._lock:
            if self._problem:
                return CurrentImage(None, ImagePose(None, self._problem))
            return self._newest(now_ns, frame)

    def image(self, number: int) -> ImageSample:
        """Image ``number``, one of the last `_HELD`; raises `InputError` for others."""
        with self._lock:
            for held in self._held:
                if held.image.number == number:
                    return held.image
        raise InputError(f"image {number} is not held any more; expected one of the last {_HELD}")

    def _add(
        self, image: ImageSample, kind: tuple[tuple[int, ...], str], pixels: Pixels, stamp_ns: int
    ) -> None:
        last_ns = self._held[-1].stamp_ns if self._held else None
        if last_ns is not None and last_ns - _JUMP_NS <= stamp_ns <= last_ns:
            return
        if last_ns is not None and stamp_ns < last_ns:
            self._held.clear()
            self._depths.forget_times()
        self._depths.check(stamp_ns, image.pixel_mm)
        self._kind, self._problem = kind, ""
        numbered = ImageSample(self._number, Stamp(stamp_ns), ImageStatus.OK, pixels)
        self._held.append(_Held(numbered, stamp_ns, self._depths.at(stamp_ns)))
        self._number += 1

    def _newest(self, now_ns: int, frame: str) -> CurrentImage:
        """The newest image whose poses have come, or why there is none."""
        waiting: str = ""
        for held in reversed(self._held):
            problem = self._age_problem(held, now_ns)
            if problem:
                return CurrentImage(held.image.number, ImagePose(None, waiting or problem))
            if held.frame != frame or held.place is None:
                found = self._poses.matrix(held.stamp_ns, frame, self._depths.probe)
                if isinstance(found, str):
                    if self._poses.reaches(held.stamp_ns, frame, self._depths.probe):
                        return CurrentImage(held.image.number, ImagePose(None, found))
                    waiting = waiting or found
                    continue
                held.frame, held.place = frame, found @ held.depth.calibration.matrix
            return CurrentImage(held.image.number, ImagePose(held.place), held.depth.depth_mm)
        return CurrentImage(None, ImagePose(None, waiting or "no image yet"))

    def _age_problem(self, held: _Held, now_ns: int) -> str:
        freshness = freshness_of(held.stamp_ns, now_ns, self._limits)
        if freshness is Freshness.VALID:
            return ""
        age_ms = (now_ns - held.stamp_ns) / NS_PER_MS
        limit = f"expected at most {self._limits.stale_after_ns / NS_PER_MS:.0f} ms"
        if freshness is Freshness.FUTURE:
            return f"the image is stamped {-age_ms:.0f} ms after the poses; {limit}"
        return f"the image is {age_ms:.0f} ms old; {limit}"
