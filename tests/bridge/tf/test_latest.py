"""The newest poses of several frames, taken when they are newer than the last ones."""

import threading

import numpy as np
import pytest

from app.bridge.tf import TfLookupError, TransformBuffer
from app.bridge.tf.latest import LatestPoses

DEADLINE_S = 60.0
FRAMES = ("left", "right")


@pytest.fixture
def buffer():
    return TransformBuffer()


@pytest.fixture
def latest(buffer):
    return LatestPoses(buffer, "world", FRAMES)


def move(buffer, stamp_ns, x_mm, frames=FRAMES, *, static=False):
    for place, frame in enumerate(frames):
        pose = (x_mm, 10.0 * place, 0.0, 0.0, 0.0, 0.0, 1.0)
        buffer.insert("world", frame, stamp_ns, pose, static=static)


def test_the_newest_poses_win_and_the_rest_is_counted(buffer, latest):
    for number in range(1, 6):
        move(buffer, number, float(number))
        latest.received()
    poses = latest.take(0.0)
    assert (poses.root, poses.frames, poses.stamp_ns) == ("world", FRAMES, 5)
    assert np.array_equal(poses.matrices[:, :3, 3], [[5.0, 0.0, 0.0], [5.0, 10.0, 0.0]])
    assert latest.superseded == 4
    assert latest.take(0.0) is None


def test_a_message_about_something_else_brings_no_poses(buffer, latest):
    move(buffer, 1, 0.0)
    latest.received()
    assert latest.take(0.0) is not None
    move(buffer, 2, 0.0, ["another"])
    latest.received()
    assert latest.take(0.0) is None
    move(buffer, 2, 0.0, ["left"])  # the stamp that both have is still the first one
    latest.received()
    assert latest.take(0.0) is None
    move(buffer, 2, 0.0, ["right"])
    latest.received()
    assert latest.take(0.0).stamp_ns == 2


def test_what_is_missing_is_said_until_it_comes(buffer, latest):
    move(buffer, 1, 0.0, ["left"])
    latest.received()
    assert latest.take(0.0) is None
    assert "'right'" in latest.missing
    move(buffer, 1, 0.0)
    latest.received()
    assert latest.take(0.0) is not None
    assert latest.missing == ""


def test_a_source_that_begins_anew_is_followed(buffer, latest):
    move(buffer, 10_000_000_000, 1.0)
    latest.received()
    assert latest.take(0.0).stamp_ns == 10_000_000_000
    move(buffer, 5, 2.0)
    latest.received()
    assert latest.take(0.0).stamp_ns == 5


def test_static_edges_that_are_said_again_are_taken_again(buffer, latest):
    for x_mm in (1.0, 2.0):
        move(buffer, 0, x_mm, static=True)
        latest.received()
        poses = latest.take(0.0)
        assert poses.stamp_ns is None
        assert poses.matrices[0, 0, 3] == x_mm


def test_a_flood_about_other_frames_does_not_keep_the_reader(buffer, latest, monkeypatch):
    looked = []

    def lookup(*_):
        looked.append(1)
        assert len(looked) < 1000, "it never comes back"
        latest.received()  # the next message is there before this one has been looked at
        raise TfLookupError("not known")

    monkeypatch.setattr(buffer, "poses", lookup)
    latest.received()
    assert latest.take(0.0) is None
    assert looked == [1]


def test_a_reader_that_waits_is_woken(buffer, latest):
    taken = []

    def read():
        while len(taken) < 50:
            taken.append(latest.take(DEADLINE_S))
            shown.release()

    shown = threading.Semaphore(0)
    thread = threading.Thread(target=read)
    thread.start()
    for number in range(1, 51):
        move(buffer, number, float(number))
        latest.received()
        assert shown.acquire(timeout=DEADLINE_S)
    thread.join(DEADLINE_S)
    assert [poses.stamp_ns for poses in taken] == list(range(1, 51))
