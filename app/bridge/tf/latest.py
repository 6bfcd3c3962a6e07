"""Latest poses of many frames, for a display thread."""

import time
from collections.abc import Sequence

from app.bridge.tf.buffer import PoseSet, TransformBuffer
from app.bridge.tf.errors import TfError
from app.runtime.latest_value import LatestValue


class LatestPoses:
    """Looks up poses of ``frames`` in ``root`` at one stamp whenever ``buffer`` has newer ones.

    Use with ``TfListener(ros, buffer, received=latest.received)``; another thread calls `take` in a
    loop. The lookup happens in `take`, so superseded updates cost nothing. `superseded` counts the
    messages that arrived between two calls of `take`, but for the last. `missing` is the reason
    why a frame has no pose yet; it is empty once all frames have one.
    """

    def __init__(self, buffer: TransformBuffer, root: str, frames: Sequence[str]) -> None:
        self.missing = ""
        self._buffer = buffer
        self._root = root
        self._frames = tuple(frames)
        self._changes = LatestValue[bool]()
        self._taken_ns: int | None = None

    def received(self) -> None:
        """Signal that the buffer has new samples. Thread-safe."""
        self._changes.put(True)

    @property
    def superseded(self) -> int:
        """Number of messages that were superseded before `take` was called."""
        return self._changes.superseded

    def take(self, timeout_s: float) -> PoseSet | None:
        """Wait for poses whose common stamp differs from that of the previous call.

        None after ``timeout_s``. Poses over static edges only have no stamp; they are returned
        after every message.
        """
        end_s = time.monotonic() + timeout_s
        while True:
            remaining_s = end_s - time.monotonic()
            if not self._changes.take(max(0.0, remaining_s)):
                return None
            poses = self._newer()
            if poses is not None:
                return poses
            if remaining_s <= 0.0:
                return None  # many messages about other frames must not extend the timeout

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
