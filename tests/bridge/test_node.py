"""`RosNode`: delivery to other processes, callbacks and release of resources on close."""

import ctypes
import threading
from contextlib import nullcontext

import pytest
import rclpy
from rclpy.serialization import deserialize_message
from std_msgs.msg import String

from app.bridge.environment import fast_dds, fast_dds_participant
from app.bridge.node import RosNode
from app.bridge.ros_errors import BridgeError
from app.bridge.topics import LATCHED, STREAM, Topic
from tests.bridge.nodes import ros_nodes
from tests.waiting import DEADLINE_S, wait_until

pytestmark = pytest.mark.slow

CHANGES = Topic("~/changes", String, STREAM)
STATUS = Topic("~/status", String, LATCHED)
STRING = "std_msgs/msg/String"


def test_matched_subscriber_gets_every_message(domain_id, start_receiver):
    with RosNode("sender", domain_id=domain_id) as ros:
        publisher = ros.publisher(CHANGES)
        receiver = start_receiver(f"/sender/changes:{STRING}:50")
        assert ros.wait_for_subscribers(CHANGES, 1, timeout_s=DEADLINE_S)
        for number in range(50):
            publisher.publish(String(data=str(number)))
        received = receiver.messages()
    assert [line["message"]["data"] for line in received] == [str(n) for n in range(50)]


def test_late_subscriber_gets_the_last_latched_message(domain_id, start_receiver):
    with RosNode("sender", namespace="site_1", domain_id=domain_id) as ros:
        publisher = ros.publisher(STATUS)
        publisher.publish(String(data="old"))
        publisher.publish(String(data="new"))
        received = start_receiver(f"/site_1/sender/status:{STRING}:1:latched").messages()
    assert [line["message"]["data"] for line in received] == ["new"]


@pytest.mark.parametrize("suspended", [False, True])
def test_messages_published_before_close_arrive(domain_id, start_receiver, suspended):
    # 2 MB at once to a suspended process: ten times the initial size of a socket buffer.
    with RosNode("sender", domain_id=domain_id) as ros:
        publisher = ros.publisher(CHANGES)
        receiver = start_receiver(f"/sender/changes:{STRING}:100")
        assert ros.wait_for_subscribers(CHANGES, 1, timeout_s=DEADLINE_S)
        with receiver.held() if suspended else nullcontext():
            for _ in range(100):
                publisher.publish(String(data="x" * 20_000))
    assert len(receiver.messages()) == 100


def test_timer_that_is_due_is_cancelled_by_another_thread(domain_id):
    with RosNode("timers", domain_id=domain_id) as ros:
        cancelled = threading.Semaphore(0)

        def cancel(message):  # the node's thread waits until it returns
            timer = ros.every(1e-4, lambda: None)
            while timer.time_until_next_call() > -20_000_000:  # due for 20 ms
                threading.Event().wait(0.001)
            ros.cancel(timer)
            cancelled.release()

        ros.subscribe(CHANGES, cancel)
        publisher = ros.publisher(CHANGES)
        assert ros.wait_for_subscribers(CHANGES, 1, timeout_s=DEADLINE_S)
        for _ in range(5):
            publisher.publish(String())
            assert cancelled.acquire(timeout=DEADLINE_S)
        ros.call(lambda: None)
        assert ros.failures == 0


def test_polled_messages_are_delivered_by_the_polling_thread_alone(domain_id):
    words = Topic("/words", String, STREAM)
    found, seen, busy, go_on = [], threading.Event(), threading.Event(), threading.Event()

    def take(data, _):
        found.append((deserialize_message(data, String).data, threading.current_thread()))

    def block():
        busy.set()
        assert go_on.wait(DEADLINE_S)

    with ros_nodes(domain_id, "receiver", "sender") as (ros, sender):
        polled = ros.subscribe_with_origin(words, take, polled=True)
        publisher = sender.publisher(words)
        assert sender.wait_for_subscribers(words, 1, DEADLINE_S)
        ros.poll(polled)
        assert found == []
        # Delivered by the node's thread, to a reader that was created after the polled one.
        ros.subscribe(words, lambda each: seen.set() if each.data == "2" else None)
        assert sender.wait_for_subscribers(words, 2, DEADLINE_S)
        for number in range(3):
            publisher.publish(String(data=str(number)))
        assert seen.wait(DEADLINE_S)
        ros.call_soon(block)  # a callback that waits for the thread that polls
        assert busy.wait(DEADLINE_S)
        assert found == []
        wait_until(lambda: ros.poll(polled) or len(found) == 3)
        go_on.set()
        ros.call(lambda: ros.destroy_subscription(polled))
        ros.poll(polled)
    assert found == [(str(number), threading.current_thread()) for number in range(3)]


def test_wait_for_subscribers_times_out(domain_id):
    with RosNode("sender", domain_id=domain_id) as ros:
        ros.publisher(CHANGES)
        assert not ros.wait_for_subscribers(CHANGES, 1, timeout_s=0.01)


def test_closing_ends_the_thread_and_can_be_repeated(domain_id):
    before = set(threading.enumerate())
    ros = RosNode("sender", domain_id=domain_id)
    assert ros.is_open
    assert set(threading.enumerate()) - before
    ros.close()
    ros.close()
    assert not ros.is_open
    assert set(threading.enumerate()) == before


def test_callback_cannot_close_its_own_node(domain_id):
    with RosNode("sender", domain_id=domain_id) as ros:
        refused, done = [], threading.Event()

        def close():
            try:
                ros.close()
            except BridgeError as error:
                refused.append(str(error))
            done.set()

        ros.call_soon(close)
        assert done.wait(DEADLINE_S)
        assert "'sender'" in refused[0]
        assert ros.is_open
    assert not ros.is_open


def test_closed_node_calls_nothing(domain_id):
    ros = RosNode("sender", domain_id=domain_id)
    ros.close()
    called = []
    ros.call_soon(lambda: called.append("soon"))
    ros.call(lambda: called.append("now"))
    ros.wake()
    assert not called


def test_failed_callbacks_are_counted_and_logged_once_a_second(domain_id, capfd):
    def fail():
        raise ValueError("no such tool")

    with RosNode("sender", domain_id=domain_id) as ros:
        for _ in range(100):
            ros.call(fail)
        ros.call(lambda: None)  # the last failure is counted after its call has ended
        assert ros.failures == 100
    logged = capfd.readouterr().err.count("ValueError: no such tool")
    assert 1 <= logged < 10


WITHOUT_CLOSE = """
import atexit
from app.bridge import RosNode
nodes = []
atexit.register(lambda: print(nodes[0].is_open))  # runs after the node's own callback
nodes.append(RosNode("unclosed"))
"""


def test_open_node_is_closed_at_exit(start):
    # An open node's thread would abort the program, but not always, so check `is_open` instead.
    ended = start("-c", WITHOUT_CLOSE)
    assert ended.line() == "False"
    assert ended.wait() == 0


def test_default_context_is_not_used(domain_id):
    with RosNode("sender", domain_id=domain_id):
        assert not rclpy.ok()


def test_two_nodes_in_one_process(domain_id):
    with RosNode("one", domain_id=domain_id) as one, RosNode("two", domain_id=domain_id) as two:
        one.close()
        assert two.is_open


def test_no_discovery_callback_is_left_when_a_node_is_destroyed(domain_id, monkeypatch):
    """Else Fast DDS waits for it while it holds the lock that the callback needs."""
    listener = fast_dds("_ZNK8eprosima7fastdds3dds17DomainParticipant12get_listenerEv")
    listener.restype = ctypes.c_void_p
    ros = RosNode("one", domain_id=domain_id)
    participant = ctypes.c_void_p(fast_dds_participant(ros.node.handle.pointer))
    destroy, found = ros.node.destroy_node, [listener(participant)]
    monkeypatch.setattr(
        ros.node, "destroy_node", lambda: (found.append(listener(participant)), destroy())
    )
    ros.close()
    assert found[0] is not None and found[1] is None


def test_ros_arguments_remap_topics(domain_id, start_receiver):
    remap = ("--ros-args", "-r", "~/status:=/elsewhere")
    with RosNode("sender", domain_id=domain_id, ros_args=remap) as ros:
        ros.publisher(STATUS).publish(String(data="here"))
        received = start_receiver(f"/elsewhere:{STRING}:1:latched").messages()
    assert received[0]["message"]["data"] == "here"


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(
    ("name", "namespace"), [("two words", ""), ("", ""), ("1st", ""), ("sender", "two words")]
)
def test_invalid_name_is_a_one_line_error(domain_id, name, namespace):
    with pytest.raises(BridgeError, match="cannot be started") as caught:
        RosNode(name, namespace=namespace, domain_id=domain_id)
    assert "\n" not in str(caught.value)
