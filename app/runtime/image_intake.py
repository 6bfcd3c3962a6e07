"""Decode received images in a thread of their own, so that they delay neither poses nor steps."""

import threading
from collections.abc import Callable
from typing import Generic, Protocol, TypeVar

from app.geometry import ImageSample, MarginGuardError
from app.runtime.latest_value import LatestValue

Received = TypeVar("Received")

_WAIT_S = 0.2
"""Longest time after which `close` is noticed."""


class ImageSink(Protocol):
    """Receiver of decoded images, called in the thread of an `ImageIntake`."""

    def add(self, image: ImageSample) -> None:
        """Take the next image."""

    def refuse(self, problem: str) -> None:
        """Take the reason why an image cannot be decoded."""


class ImageIntake(Generic[Received]):
    """Passes each received image through ``decode`` to ``images``; skips those it has no time for.

    ``decode`` is called in the thread of the intake. It returns None for what is no image for this
    session, and raises `MarginGuardError` for one that is refused.
    """

    def __init__(self, images: ImageSink, decode: Callable[[Received], ImageSample | None]) -> None:
        self._images, self._decode = images, decode
        self._latest: LatestValue[Received] = LatestValue()
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._work, name="images", daemon=True)
        self._thread.start()

    def put(self, received: Received) -> None:
        """Take an image as it was received; from any thread, without waiting."""
        self._latest.put(received)

    def close(self) -> None:
        """End the thread."""
        self._closing.set()
        self._thread.join()

    def _work(self) -> None:
        while not self._closing.is_set():
            received = self._latest.take(_WAIT_S)
            if received is None:
                continue
            try:
                image = self._decode(received)
            except MarginGuardError as error:
                self._images.refuse(str(error))
                continue
            if image is not None:
                self._images.add(image)
