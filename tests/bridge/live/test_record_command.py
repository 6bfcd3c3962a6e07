"""``marginguard record`` in one process, a tracker and a robot in another."""

import json
import signal
import threading
from collections import Counter

import pytest
import yaml
from marginguard_msgs.msg import FixtureConstraint
from marginguard_msgs.srv import SetTumor
from mcap.exceptions import McapError
from mcap.reader import make_reader
from mcap.records import Channel, Message
from mcap.stream_reader import StreamReader
from rosbags.interfaces import QosDurability, QosReliability
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from std_msgs.msg import String
from visualization_msgs.msg import Marker

from app.bridge.calls import ServiceClient
from app.bridge.convert import qos_profile
from app.bridge.node import RosNode
from app.bridge.topics import STREAM, Topic
from app.case import open_case
from tests.bridge.conftest import SENDER as SENDER
from tests.bridge.conftest import TRACKED as TRACKED
from tests.bridge.service_calls import tumor
from tests.waiting import DEADLINE_S, wait_until

pytestmark = pytest.mark.long


@pytest.fixture
def recorded(start_sender, start, live_yaml, tmp_path):
    """Recorder after the tracker has sent all frames, its case, and the shift of the stamps."""
    case = tmp_path / "case"
    config = live_yaml(TRACKED)
    recorder = start("-m", "app.cli", "record", "-o", str(case), "--config", str(config))
    sender = start_sender("tracked")
    recorder.line(lambda line: line == "recording /tracked_transforms\n")
    shift_ns = int(sender.line(lambda line: line.startswith("shift")).split()[1])
    sender.line(lambda line: line == "sent\n")
    return recorder, case, shift_ns


def samples_of(frames, shift_ns=0):
    return {
        (sample.stamp.ns - shift_ns, sample.source): sample
        for frame in frames
        for sample in frame.poses
    }


@pytest.fixture
def replay(start):
    """``replay(case)``: summary of the case by ``marginguard replay --json``."""
    return lambda case: json.loads(
        "".join(start("-m", "app.cli", "replay", case, "--no-ros", "--json").lines())
    )


def test_recording_is_a_case_and_a_bag(recorded, breach, replay):
    recorder, case, shift_ns = recorded
    recorder.stop()

    sent = samples_of(breach)
    found = samples_of(open_case(case).recorded_frames(), shift_ns)
    assert len(found) >= 0.9 * len(sent)  # the recorder may have discovered the tracker late
    for key, sample in found.items():
        expected = sent[key].transform
        assert sample.transform.rotation == pytest.approx(expected.rotation, abs=1e-12)
        assert sample.transform.translation_mm == pytest.approx(expected.translation_mm, abs=1e-9)
    summary = replay(case)
    assert min(breach_["min_signed_distance_mm"] for breach_ in summary["breaches"]) < 0.0

    types = get_typestore(Stores.EMPTY)
    with Reader(case / "tracking") as bag:
        counts = {topic: info.msgcount for topic, info in bag.topics.items()}
        assert counts["/tracked_transforms"] == len(found)
        assert counts["/joint_states"] > 0
        (connection,) = bag.topics["/tracked_transforms"].connections
        (qos,) = connection.ext.offered_qos_profiles
        assert qos.reliability is QosReliability.RELIABLE
        assert qos.durability is QosDurability.VOLATILE
        assert connection.digest.startswith("RIHS01_")
        types.register(get_types_from_msg(connection.msgdef.data, connection.msgtype))
        for _, received_ns, data in bag.messages([connection]):
            message = types.deserialize_cdr(data, connection.msgtype)
            stamp = message.header.stamp
            stamp_ns = stamp.sec * 10**9 + stamp.nanosec
            assert (stamp_ns - shift_ns, message.child_frame_id) in sent
            assert stamp_ns <= received_ns
    with (case / "tracking" / "tracking_0.mcap").open("rb") as file:
        reader = make_reader(file)
        assert reader.get_header().profile == "ros2"
        by_topic = Counter(channel.topic for _, channel, _ in reader.iter_messages())
    assert by_topic == counts


def test_recording_survives_a_kill(recorded, breach, replay, start, tmp_path):
    recorder, case, shift_ns = recorded
    recorder.end(signal.SIGKILL)
    assert not (case / "tracking" / "metadata.yaml").exists()

    messages = 0
    with (case / "tracking" / "tracking_0.mcap").open("rb") as file:
        try:
            for record in StreamReader(file).records:
                messages += isinstance(record, Message)
        except McapError:
            pass  # the file is incomplete
    sent = samples_of(breach)
    found = samples_of(open_case(case).recorded_frames(), shift_ns)
    assert found.keys() <= sent.keys()
    assert messages >= len(found) >= 0.5 * len(sent)
    assert replay(case)["valid_frames"] > 0
    # Conversion makes a complete file, which some players require.
    assert start("-m", "app.cli", "convert", case, tmp_path / "complete").wait() == 0
    with (tmp_path / "complete" / "tracking.mcap").open("rb") as file:
        topics = Counter(channel.topic for _, channel, _ in make_reader(file).iter_messages())
    assert topics["/tracked_transforms"] == len(found)


def test_existing_recording_is_not_overwritten(start, tmp_path):
    (tmp_path / "case").mkdir()
    recorder = start("-m", "app.cli", "record", "-o", str(tmp_path / "case"))
    assert recorder.wait() == 2
    assert "already exists; refusing to overwrite it" in recorder.log.read_text()
    assert list((tmp_path / "case").iterdir()) == []


def messages_of(case, topic):
    """Recorded messages of a topic, read by rosbags."""
    types = get_typestore(Stores.EMPTY)
    with Reader(case / "tracking") as bag:
        (connection,) = bag.topics[topic].connections
        types.register(get_types_from_msg(connection.msgdef.data, connection.msgtype))
        for _, _, data in bag.messages([connection]):
            yield types.deserialize_cdr(data, connection.msgtype)


def test_late_best_effort_publishers_are_recorded_without_duplicates(start, domain_id, tmp_path):
    reliable_topic = Topic("/changes", String, STREAM)
    best_effort_topic = Topic("/changes", String, qos_profile(reliability="best_effort", depth=100))
    with RosNode("sender", domain_id=domain_id) as ros:
        reliable = ros.publisher(reliable_topic)
        recorder = start(
            "-m", "app.cli", "record", "-o", str(tmp_path / "x"), "--topics", "/changes"
        )
        recorder.line(lambda line: line == "recording /changes\n")
        assert ros.wait_for_subscribers(reliable_topic, 1, timeout_s=DEADLINE_S)
        for number in range(100):
            reliable.publish(String(data=f"first {number}"))
        best_effort = ros.publisher(best_effort_topic)
        assert ros.wait_for_subscribers(best_effort_topic, 1, timeout_s=DEADLINE_S)
        assert ros.wait_for_subscribers(reliable_topic, 2, timeout_s=DEADLINE_S)
        pause = threading.Event()
        for number in range(100):
            reliable.publish(String(data=f"second {number}"))
            best_effort.publish(String(data=f"weak {number}"))
            # Best effort repeats nothing that a full buffer dropped.
            ros.flush() if number == 50 else pause.wait(0.005)
    recorder.stop()
    counts = Counter(message.data for message in messages_of(tmp_path / "x", "/changes"))
    assert set(counts.values()) == {1}
    for kind in ("first", "second"):
        assert sum(text.startswith(kind) for text in counts) == 100
    weak = [int(text.split()[1]) for text in counts if text.startswith("weak")]
    assert weak == list(range(weak[0], 100))


def test_two_simultaneous_sessions_are_reported_and_are_one_change(start, domain_id, tmp_path):
    name = "/marginguard/constraint"
    topic = Topic(name, FixtureConstraint, STREAM)
    recorder = start("-m", "app.cli", "record", "-o", str(tmp_path / "x"))
    with RosNode("one", domain_id=domain_id) as one, RosNode("two", domain_id=domain_id) as two:
        first = one.publisher(topic)
        recorder.line(lambda line: line == f"recording {name}\n")
        assert one.wait_for_subscribers(topic, 1, timeout_s=DEADLINE_S)
        first.publish(FixtureConstraint(instance_id="1", model_id="one"))
        pause = threading.Event()
        # The first session must be recorded before the second starts.
        wait_until(lambda: any(each == name for each, _ in recorded_sizes(tmp_path / "x")))
        second = two.publisher(topic)
        recorder.line(lambda line: line.startswith(f"{name} has 2 publishers; several sessions"))
        assert two.wait_for_subscribers(topic, 1, timeout_s=DEADLINE_S)
        for _ in range(10):
            second.publish(FixtureConstraint(instance_id="2", model_id="two"))
            pause.wait(0.12)  # the recorder checks every 0.1 s
            first.publish(FixtureConstraint(instance_id="1", model_id="one"))
            pause.wait(0.12)
    recorder.stop()
    assert "".join(recorder.lines()).count("were replaced") == 1
    (change,) = yaml.safe_load((tmp_path / "x" / "tracking" / "changes.yaml").read_text())[
        "changes"
    ]
    assert change["model_id"] == "two"


def recorded_sizes(case):
    """Topic and size in bytes of each message in a file that is still being written."""
    topics = {}
    with (case / "tracking" / "tracking_0.mcap").open("rb") as file:
        try:
            for record in StreamReader(file).records:
                if isinstance(record, Channel):
                    topics[record.id] = record.topic
                elif isinstance(record, Message):
                    yield topics[record.channel_id], len(record.data)
        except McapError:
            pass  # the file is incomplete


def has_surface_and_samples(case):
    largest = {}
    for topic, size in recorded_sizes(case):
        largest[topic] = max(size, largest.get(topic, 0))
    surface = largest.get("/site_1/marginguard/markers", 0) > 2_000
    return surface and "/tracked_transforms" in largest


def test_replaced_tumour_is_noted_in_the_recording(
    start_sender, start, live_yaml, domain_id, tmp_path
):
    config = str(live_yaml(TRACKED))
    case = tmp_path / "case"
    session_options = ("--config", config, "--namespace", "site_1")
    recorder = start("-m", "app.cli", "record", "-o", str(case), *session_options)
    start("-m", "app.cli", "live", "--constraint-hz", "100", *session_options)
    start_sender("tracked", "again")
    recorder.line(lambda line: line == "recording /site_1/marginguard/constraint\n")
    with RosNode("operator", domain_id=domain_id) as ros:
        client = ServiceClient(ros, SetTumor, "/site_1/marginguard/set_tumor")
        reply = client.call(tumor(0.02), DEADLINE_S)
    assert reply.success, reply.message
    recorder.line(lambda line: line == "tumour or registration of the session were replaced\n")
    recorder.line(lambda line: line == "recording /site_1/marginguard/markers\n")
    wait_until(lambda: has_surface_and_samples(case), describe=recorder.log.read_text)
    recorder.stop()

    (change,) = yaml.safe_load((case / "tracking" / "changes.yaml").read_text())["changes"]
    assert change["model_id"] == reply.model_id
    assert change["replaced"] == "tumour"
    surfaces = [
        marker
        for message in messages_of(case, "/site_1/marginguard/markers")
        for marker in message.markers
        if marker.type == Marker.TRIANGLE_LIST and marker.ns == "tumor"
    ]
    corners = {(point.x, point.y, point.z) for point in surfaces[-1].points}
    assert corners == {(0, 0, 0), (0.02, 0, 0), (0, 0.02, 0), (0, 0, 0.02)}
    opened = open_case(case)
    assert any(opened.recorded_frames())
    note = "changes.yaml: tumour, structures, registration, tip or margins were replaced"
    assert any(note in each for each in opened.notes())
