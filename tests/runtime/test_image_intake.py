"""Received images are decoded in a thread of their own, the newest only."""

import threading

import numpy as np

from app.case import ImageDepths
from app.geometry import ImageCalibration, ImageSample, ImageStatus, InputError, Stamp
from app.runtime import ImageIntake
from app.session import LiveImages

DEADLINE_S = 60.0


def some_images() -> LiveImages:
    calibration = ImageCalibration("probe", np.diag([0.1, 0.1, 0.1, 1.0]))
    return LiveImages(ImageDepths.one(calibration), stale_after_ns=1, max_gap_ns=1)


def image(ns: int) -> ImageSample:
    return ImageSample(0, Stamp(ns), ImageStatus.OK, np.zeros((2, 2), np.uint8))


def test_slow_decoder_skips_to_the_newest_image() -> None:
    images, seen = some_images(), []
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
    assert intake.counts() == {"images: received": 2, "images: skipped": 3}


def test_refused_image_does_not_end_the_thread() -> None:
    images = some_images()
    reported, done = threading.Event(), threading.Event()
    images.report = lambda problem: reported.set()

    def decode(number: int) -> ImageSample | None:
        if number == 0:
            raise InputError("encoding of the image is 'bgr8'")
        done.set()
        return None

    intake = ImageIntake(images, decode)
    intake.put(0)
    assert reported.wait(DEADLINE_S)
    intake.put(1)
    assert done.wait(DEADLINE_S)
    intake.close()
    assert images.problem == "encoding of the image is 'bgr8'"
    assert intake.counts()["images: refused"] == 1
