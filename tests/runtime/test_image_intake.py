"""Received images are decoded in a thread of their own, the newest only."""

import threading

import numpy as np

from app.geometry import ImageSample, ImageStatus, InputError, Stamp
from app.runtime import ImageIntake

DEADLINE_S = 60.0


class Sink:
    """Stamps of the images that were added, and the problem of the last one that was refused."""

    def __init__(self) -> None:
        self.stamps_ns: list[int] = []
        self.problem = ""

    def add(self, image: ImageSample) -> None:
        assert image.stamp is not None
        self.stamps_ns.append(image.stamp.ns)

    def refuse(self, problem: str) -> None:
        self.problem = problem


def image(ns: int) -> ImageSample:
    return ImageSample(0, Stamp(ns), ImageStatus.OK, np.zeros((2, 2), np.uint8))


def test_slow_decoder_skips_to_the_newest_image():
    images, seen = Sink(), []
    begun, go_on, last = threading.Event(), threading.Event(), threading.Event()

    def decode(number: int) -> ImageSample:
        seen.append(number)
        begun.set()
        assert go_on.wait(DEADLINE_S)
        if number == 4:
            last.set()
        return image(number + 1)

    intake = ImageIntake(images, decode)
    intake.put(0)
    assert begun.wait(DEADLINE_S)
    for number in (1, 2, 3, 4):
        intake.put(number)
    go_on.set()
    assert last.wait(DEADLINE_S)
    intake.close()
    assert seen == [0, 4]
    assert images.stamps_ns == [1, 5]


def test_refused_image_does_not_end_the_thread():
    images, refused, done = Sink(), threading.Event(), threading.Event()

    def decode(number: int) -> ImageSample | None:
        if number == 0:
            refused.set()
            raise InputError("encoding of the image is 'bgr8'")
        done.set()
        return None

    intake = ImageIntake(images, decode)
    intake.put(0)
    assert refused.wait(DEADLINE_S)
    intake.put(1)
    assert done.wait(DEADLINE_S)
    intake.close()
    assert images.problem == "encoding of the image is 'bgr8'"
