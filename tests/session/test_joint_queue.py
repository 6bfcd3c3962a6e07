"""Joints wait in a queue of bounded length for the tracker's present."""

from app.geometry import NS_PER_MS, Stamp
from app.session.joint_queue import MAX_JOINTS, JointQueue
from tests.doubles import joint_sample

AHEAD_MS = 200


def queue_of(*stamps_ms):
    queue = JointQueue(AHEAD_MS * NS_PER_MS)
    for at_ms in stamps_ms:
        assert queue.add(joint_sample({"waist": 0.1}, at_ms))
    return queue


def taken_ms(queue, now_ms):
    return [sample.stamp.ns / NS_PER_MS for sample in queue.take(Stamp(now_ms * NS_PER_MS))]


def test_newest_joints_that_are_not_ahead_are_taken_once():
    queue = queue_of(10, 30, 20, 40)  # one came late, yet before it was needed
    assert taken_ms(queue, 9) == []
    assert taken_ms(queue, 30) == [30]
    assert taken_ms(queue, 39) == []
    assert not queue.add(joint_sample({"waist": 0.1}, 25))
    assert taken_ms(queue, 60) == [40]
    assert taken_ms(queue, 80) == []


def test_joints_further_ahead_than_the_limit_are_taken_at_once():
    assert taken_ms(queue_of(10, 210), 10) == [10]
    queue = queue_of(10, 211)
    assert taken_ms(queue, 10) == [211]
    assert queue.add(joint_sample({"waist": 0.1}, 20))  # the present has not reached 211
    assert taken_ms(queue, 20) == [20]


def test_queue_is_bounded_and_keeps_the_newest():
    queue = queue_of(*(0.5 * index for index in range(MAX_JOINTS + 50)))
    assert taken_ms(queue, 24) == []
    assert taken_ms(queue, 25) == [25]
    assert taken_ms(queue, 1000) == [0.5 * (MAX_JOINTS + 49)]
