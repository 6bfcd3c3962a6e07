"""Fits of a guided recording that fail: the page goes on, and another recording is fitted again."""

import threading
from dataclasses import dataclass

from app.runtime import compute_here
from app.workflow.guided_recording import MAX_FAILURES, GuidedFits


@dataclass
class Task:
    run: int


class GuideDouble:
    """Test double of a guide that always has a task."""

    def __init__(self):
        self.run, self.fits = 1, []

    def task(self):
        return Task(self.run)

    def use_fit(self, fit):
        self.fits.append(fit)


def test_errors_of_a_fit_are_bounded_and_another_recording_is_fitted_again():
    guide, computed, tried = GuideDouble(), threading.Semaphore(0), []

    def fit(task):
        tried.append(task.run)
        if task.run == 1:
            raise ZeroDivisionError("of the program")
        return task.run

    fits = GuidedFits(guide, fit, compute_here, computed.release)
    for _ in range(MAX_FAILURES):
        fits.follow()
        assert computed.acquire(timeout=60.0)
        assert fits.is_done
    fits.follow()
    assert not fits.is_done
    fits.follow()
    assert tried == [1] * MAX_FAILURES
    assert guide.fits == []
    guide.run = 2
    fits.follow()
    assert computed.acquire(timeout=60.0)
    fits.follow()
    assert guide.fits == [2]
    assert computed.acquire(timeout=60.0)
    fits.close()
