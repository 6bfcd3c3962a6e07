"""Time of a recorded message; changes of a session, detected from its constraints."""

import time

import pytest
from marginguard_msgs.msg import FixtureConstraint
from rclpy.duration import Duration
from rclpy.serialization import serialize_message
from std_msgs.msg import String

from app.bridge import topics
from app.bridge.live.ros_recorder import RosRecorder, SessionWatch
from app.case import BagWriter
from tests.bridge.nodes import ros_nodes
from tests.waiting import DEADLINE_S, wait_until

pytestmark = pytest.mark.slow


def changes_of(watch: SessionWatch, *samples: str) -> list[bool]:
    """`SessionWatch.has_changed` for constraints in sequence: an instance and a model id each."""
    return [
        watch.has_changed(
            (ns, serialize_message(FixtureConstraint(instance_id=sample[0], model_id=sample[1])))
        )
        for ns, sample in enumerate(samples)
    ]


@pytest.fixture
def watch() -> SessionWatch:
    watch = SessionWatch()
    watch.has_new_publisher(1)
    return watch


def test_one_session_changes_back_and_forth(watch):
    assert changes_of(watch, "1a", "1a", "1b", "1b", "1a") == [False, False, True, False, True]
    assert [(c.received_ns, c.model_id) for c in watch.changes] == [(2, "b"), (4, "a")]


def test_alternating_sessions_are_one_change(watch):
    assert sum(changes_of(watch, *["1a", "2b"] * 27)) == 1
    assert [change.model_id for change in watch.changes] == ["b"]


def test_change_of_one_of_two_sessions_is_detected_also_back_to_earlier_ids(watch):
    samples = ["1a", "2b", "1a", "2b", "1c", "2b", "1c", "1a", "2b", "1a"]
    changed = [False, True, False, False, True, False, False, True, False, False]
    assert changes_of(watch, *samples) == changed


def test_restarted_session_is_a_change_only_with_other_ids(watch):
    assert changes_of(watch, "1a", "2a", "2a", "3b") == [False, False, False, True]


def test_new_publisher_is_detected(watch):
    counts = [1, 2, 2, 3, 2, 1, 0, 1, 2]
    new = [watch.has_new_publisher(count) for count in counts]
    assert new == [False, True, False, True, False, False, False, False, True]
    assert SessionWatch().has_new_publisher(2)


def test_invalid_bytes_are_no_change(watch):
    changes_of(watch, "1a")
    assert not watch.has_changed((7, b"no constraint"))
    assert not watch.has_changed(None)
    assert watch.changes == []


def test_change_that_the_session_reports_has_the_ids_of_the_last_constraint(watch):
    watch.note_replaced(5, "tip")
    changes_of(watch, "1a", "1b")
    watch.note_replaced(9, "tip")
    found = [(each.received_ns, each.model_id, each.replaced) for each in watch.changes]
    assert found == [(5, "", "tip"), (1, "b", "tumour"), (9, "b", "tip")]


def test_recorded_time_is_that_of_the_receipt_although_the_thread_was_busy(domain_id, tmp_path):
    name, acknowledged_ns = topics.PLAYBACK.name, []
    with ros_nodes(domain_id, "recorder", "sender") as (ros, sender):
        publisher = sender.publisher(topics.PLAYBACK)
        bag = BagWriter(tmp_path / "bag")
        recorder = RosRecorder(ros, bag, [name])
        wait_until(lambda: not recorder.waiting, lambda: ros.call(recorder.discover))
        assert sender.wait_for_subscribers(topics.PLAYBACK, 1, DEADLINE_S)

        def send():
            publisher.publish(String(data="case 1"))
            assert publisher.wait_for_all_acked(Duration(seconds=DEADLINE_S))
            acknowledged_ns.append(time.time_ns())

        ros.call(send)
        received_ns, _ = wait_until(lambda: recorder.last(name))
        assert received_ns <= acknowledged_ns[0]
        bag.close()
