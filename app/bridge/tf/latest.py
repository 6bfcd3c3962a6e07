"""The newest poses of many frames, for a thread that shows them."""

import time
from collections.abc import Sequence

from app.bridge.tf.buffer import PoseSet, TransformBuffer
from app.bridge.tf.errors import TfError
from app.runtime.latest_value import LatestValue


class LatestPoses:
    """Poses of ``frames`` in ``root`` at one stamp, taken from ``buffer`` whenever they are newer.

    ``TfListener(ros, buffer, received=latest.received)`` fills and wakes it; another thread calls
    `take` in a loop. They are looked up when they are taken, so a set that is superseded costs
    nothing; `superseded` counts the messages that were followed by another before anyone looked.
    `missing` says why there are no poses of all frames yet, and is empty once there are.
    """

    def __init__(self, buffer: TransformBuffer, root: str, frames: Sequence[str]) -> None:
        self.missing = ""
        self._buffer = buffer
        self._root = root
        self._frames = tuple(frames)
        self._news = LatestValue[bool]()
        self._taken_ns: int | None = None

    def received(self) -> None:
        """Say that the buffer has something new; from any thread."""
        self._news.put(True)

    @property
    def superseded(self) -> int:
        """How many messages were not looked at because a newer one was there already."""
        return self._news.superseded

    def take(self, timeout_s: float) -> PoseSet | None:
        """The newest poses, as soon as their common stamp is another than that of the last ones.

        None when there were none in ``timeout_s``. A set over static edges alone has no stamp: it
        is taken after every message.
        """
        until_s = time.monotonic() + timeout_s
        while True:
            left_s = until_s - time.monotonic()
            if not self._news.take(max(0.0, left_s)):
                return None
            poses = self._newer()
            if poses is not None:
                return poses
            if left_s <= 0.0:
                return None  # a flood of messages about other frames must not keep us here

    def _newer(self) -> PoseSet | None:
        try:
            poses = self._buffer.poses(self._root, self._frames)
        except TfError as error:
            self.missing = str(error)
            return None
        self.missing = ""
        if poses.stamp_ns is not None and poses.stamp_ns == self._taken_ns:
            return None
        self._taken_ns = poses.stamp_ns
        return poses
