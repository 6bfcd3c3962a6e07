"""Changes of a session detected from its constraints, with one and with two sessions."""

import pytest
from marginguard_msgs.msg import FixtureConstraint
from rclpy.serialization import serialize_message

from app.bridge.live import SessionWatch


def changes_of(watch: SessionWatch, *model_ids: str) -> list[bool]:
    """`SessionWatch.has_changed` for constraints with these model ids in sequence."""
    return [
        watch.has_changed((ns, serialize_message(FixtureConstraint(model_id=model_id))))
        for ns, model_id in enumerate(model_ids)
    ]


@pytest.fixture
def watch() -> SessionWatch:
    watch = SessionWatch()
    watch.has_new_publisher(1)
    return watch


def test_one_session_changes_back_and_forth(watch):
    assert changes_of(watch, "a", "a", "b", "b", "a") == [False, False, True, False, True]
    assert [(c.received_ns, c.model_id) for c in watch.changes] == [(2, "b"), (4, "a")]


def test_alternating_sessions_are_one_change(watch):
    watch.has_new_publisher(2)
    assert sum(changes_of(watch, *"ab" * 27)) == 1
    assert [change.model_id for change in watch.changes] == ["b"]


def test_new_ids_of_two_sessions_are_a_change(watch):
    watch.has_new_publisher(2)
    assert changes_of(watch, *"abab", "c", *"acac") == [
        False,
        True,
        *[False] * 2,
        True,
        *[False] * 4,
    ]


def test_remaining_session_is_the_recorded_one(watch):
    watch.has_new_publisher(2)
    changes_of(watch, *"abab")
    watch.has_new_publisher(1)
    assert changes_of(watch, *"aaa") == [True, False, False]
    assert [change.model_id for change in watch.changes] == ["b", "a"]


def test_new_publisher_is_detected(watch):
    counts = [1, 2, 2, 3, 2, 1, 0, 1, 2]
    new = [watch.has_new_publisher(count) for count in counts]
    assert new == [False, True, False, True, False, False, False, False, True]
    assert SessionWatch().has_new_publisher(2)


def test_invalid_bytes_are_no_change(watch):
    changes_of(watch, "a")
    assert not watch.has_changed((7, b"no constraint"))
    assert not watch.has_changed(None)
    assert watch.changes == []
