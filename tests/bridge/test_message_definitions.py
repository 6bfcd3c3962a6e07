"""Definitions of our messages: expected, installed, and announced by other endpoints."""

import inspect
import json
import re
import shutil
from pathlib import Path

import marginguard_msgs
import pytest
from marginguard_msgs.msg import FixtureConstraint, TrackedTransform
from marginguard_msgs.srv import Register
from rclpy.qos import QoSProfile
from rclpy.topic_endpoint_info import TopicEndpointInfo, TopicEndpointTypeEnum
from rclpy.type_hash import TypeHash
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from app.bridge.calls import ServiceClient, ServiceServer
from app.bridge.message_definitions import (
    EXPECTED,
    DefinitionWatch,
    check_installed,
    checked_callback,
    expected_digest,
    foreign_clients,
    foreign_endpoints,
)
from app.bridge.ros_errors import BridgeError
from tests.bridge.nodes import ros_nodes
from tests.waiting import DEADLINE_S

pytestmark = pytest.mark.slow

OURS = EXPECTED["msg/FixtureConstraint"]
OTHER = "ab" * 32


def endpoint(digest=OURS, name="peer", version=1):
    return TopicEndpointInfo(
        node_name=name,
        node_namespace="/left",
        topic_type="marginguard_msgs/msg/FixtureConstraint",
        topic_type_hash=TypeHash(version=version, value=bytes.fromhex(digest)),
        endpoint_type=TopicEndpointTypeEnum.PUBLISHER,
        endpoint_gid=[0] * 16,
        qos_profile=QoSProfile(depth=1),
    )


class Graph:
    """Test double of the endpoints that are connected to one topic."""

    def __init__(self, *endpoints):
        self.endpoints = list(endpoints)
        self.connected = len(endpoints)
        self.listed = 0
        self.now_s = 0.0
        self.logged = []
        self.watch = DefinitionWatch(
            "~/constraint",
            FixtureConstraint,
            "so that its messages are not used",
            self.list,
            lambda: self.connected,
            self.logged.append,
            lambda: self.now_s,
        )

    def list(self):
        self.listed += 1
        return self.endpoints

    def connect(self, *endpoints):
        self.endpoints, self.connected = list(endpoints), len(endpoints)


def test_expected_definitions_are_those_of_the_source_files(project_root):
    folder = project_root / "interfaces" / "marginguard_msgs"
    names = {f"{path.parent.name}/{path.stem}" for path in folder.glob("*/*.*")}
    assert set(EXPECTED) == names
    store = get_typestore(Stores.ROS2_JAZZY)
    messages = {path.stem: path.read_text() for path in folder.glob("msg/*.msg")}
    for name, text in messages.items():
        store.register(get_types_from_msg(text, f"marginguard_msgs/msg/{name}"))
    for name in messages:
        digest = store.hash_rihs01(f"marginguard_msgs/msg/{name}").removeprefix("RIHS01_")
        assert EXPECTED[f"msg/{name}"] == digest, name


def test_installed_definitions_are_the_expected_ones():
    check_installed.__wrapped__()


@pytest.fixture
def other_share(tmp_path, monkeypatch):
    """Copy of the installed definitions in place of them."""
    module = Path(marginguard_msgs.__file__)
    share = next(
        folder / "share" / "marginguard_msgs"
        for folder in module.parents
        if (folder / "share" / "marginguard_msgs" / "msg").is_dir()
    )
    copy = tmp_path / "share" / "marginguard_msgs"
    shutil.copytree(share, copy)
    monkeypatch.setattr(
        marginguard_msgs, "__file__", str(tmp_path / "lib" / "marginguard_msgs" / "__init__.py")
    )
    check_installed.__wrapped__()
    return copy


@pytest.mark.parametrize("name", ["msg/HalfSpace", "srv/Rearm", "action/Replay"])
def test_other_installed_definition_is_one_line_with_the_remedy(other_share, name):
    path = other_share / f"{name}.json"
    text = path.read_text().replace(EXPECTED[name], OTHER)
    path.write_text(text)
    with pytest.raises(BridgeError) as error:
        check_installed.__wrapped__()
    expected = f"marginguard_msgs/{name}: the installed definition ({other_share}) is RIHS01_abab"
    assert str(error.value).startswith(expected)
    assert "run 'pip install ./interfaces'" in str(error.value)


@pytest.mark.parametrize("text", [None, "", "[]", json.dumps({"type_hashes": [{}]})])
def test_unreadable_installed_definition_is_refused(other_share, text):
    path = other_share / "srv" / "Seek.json"
    path.unlink() if text is None else path.write_text(text)
    with pytest.raises(BridgeError, match=re.escape("srv/Seek: the installed definition")):
        check_installed.__wrapped__()


def test_installation_without_definitions_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(marginguard_msgs, "__file__", str(tmp_path / "marginguard_msgs.py"))
    with pytest.raises(BridgeError, match="has no folder share/marginguard_msgs"):
        check_installed.__wrapped__()


def test_only_our_message_types_have_an_expected_definition():
    assert expected_digest(TrackedTransform) == EXPECTED["msg/TrackedTransform"]
    assert expected_digest(JointState) is None


def test_foreign_endpoint_is_one_that_announces_another_hash():
    endpoints = [
        endpoint(),
        endpoint(OTHER, "other"),
        endpoint("00" * 32, "without_ros", version=-1),
    ]
    assert foreign_endpoints(endpoints, FixtureConstraint) == {"/left/other": OTHER}
    assert foreign_endpoints(endpoints, JointState) == {}


def test_messages_are_not_used_while_a_foreign_publisher_is_connected():
    graph, received = Graph(endpoint()), []
    take = checked_callback(received.append, graph.watch)
    take("one")
    graph.connect(endpoint(), endpoint(OTHER, "other"))
    take("two")
    assert "~/constraint: /left/other (RIHS01_abababababab)" in graph.watch.problem
    assert "so that its messages are not used; install the same" in graph.watch.problem
    take("three")
    graph.connect(endpoint())
    take("four")
    assert received == ["one", "four"]
    assert (len(graph.logged), graph.watch.problem) == (1, "")


def test_foreign_endpoint_that_never_connected_blocks_only_until_it_leaves():
    graph = Graph(endpoint())
    graph.endpoints.append(endpoint(OTHER, "other"))
    assert not graph.watch.is_clean()
    graph.endpoints.pop()  # the number of connected endpoints stays 1
    graph.now_s = 0.05
    assert not graph.watch.is_clean()
    assert graph.listed == 1, "at most 10 checks a second"
    graph.now_s = 0.2
    assert graph.watch.is_clean()
    assert graph.watch.problem == ""
    graph.now_s = 9.0
    assert graph.watch.is_clean()
    assert graph.listed == 2, "no check without a problem"


def test_publisher_that_the_graph_does_not_know_yet_is_not_used():
    graph = Graph(endpoint())
    graph.connected = 2
    assert not graph.watch.is_clean()
    graph.endpoints.append(endpoint())
    assert graph.watch.is_clean()


def test_problem_is_logged_when_the_name_of_the_node_is_known():
    graph = Graph(endpoint(OTHER, "_NODE_NAME_UNKNOWN_"))
    assert not graph.watch.is_clean()
    assert graph.logged == []
    graph.connect(endpoint(OTHER, "other"))
    assert not graph.watch.is_clean()
    assert not graph.watch.is_clean()
    assert graph.logged == [graph.watch.problem]


def test_exchange_of_two_publishers_is_found_by_the_event_of_the_match():
    graph = Graph(endpoint())
    assert graph.watch.is_clean()
    graph.connect(endpoint(OTHER, "other"))
    graph.watch.check()
    assert not graph.watch.is_clean()


def test_callback_keeps_its_signature():
    def with_info(data, info): ...

    def alone(data): ...

    watch = Graph().watch
    for callback, count in ((with_info, 2), (alone, 1)):
        assert len(inspect.signature(checked_callback(callback, watch)).parameters) == count


REQUEST_TYPE = "marginguard_msgs::srv::dds_::Register_Request_"
REQUEST_TOPIC = "rq/left/guard/registerRequest"


class ServiceGraph:
    """Test double of a node: the endpoints of the requests of its service ``register``."""

    def __init__(self, *clients):
        self.clients = clients

    def get_name(self):
        return "guard"

    def get_namespace(self):
        return "/left"

    def get_subscriptions_info_by_topic(self, topic, *, no_mangle):
        assert (topic, no_mangle) == (REQUEST_TOPIC, True)
        return [request_endpoint(OTHER, "other_server"), request_endpoint(OURS, "guard")]

    def get_publishers_info_by_topic(self, topic, *, no_mangle):
        assert (topic, no_mangle) == (REQUEST_TOPIC, True)
        return list(self.clients)


def request_endpoint(digest, name, version=1, kind=REQUEST_TYPE):
    info = endpoint(digest, name, version)
    info.topic_type = kind
    return info


def test_clients_with_another_definition_of_a_request_are_named():
    graph = ServiceGraph(
        request_endpoint(OURS, "equal"),
        request_endpoint(OTHER, "old"),
        request_endpoint(OTHER, "without_hash", version=0),
        request_endpoint(OTHER, "not_connected", kind="other_msgs::srv::dds_::Register_Request_"),
    )
    assert foreign_clients(graph, "/left/guard/register", Register) == {"/left/old": OTHER}
    assert foreign_clients(graph, "/left/guard/register", Trigger) == {}


@pytest.mark.parametrize("in_thread", [True, False])
def test_request_of_a_client_with_our_definition_is_served_and_one_beside_another_is_refused(
    domain_id, monkeypatch, in_thread
):
    def serve(request, response):
        response.success = True

    with ros_nodes(domain_id, "guard", "operator") as (guard, operator):
        server = ServiceServer(guard, Register, "~/register", serve, in_thread=in_thread)
        client = ServiceClient(operator, Register, server.name)
        assert client.call(Register.Request(), DEADLINE_S).success
        topic = f"rq{server.name}Request"
        listed = guard.node.get_publishers_info_by_topic(topic, no_mangle=True)
        assert [str(each.node_name) for each in listed] == ["operator"]
        # The installed package has one definition only: the graph is given another hash.
        monkeypatch.setattr(
            guard.node,
            "get_publishers_info_by_topic",
            lambda *_, **__: [request_endpoint(OTHER, "old", kind=listed[0].topic_type)],
        )
        reply = client.call(Register.Request(), DEADLINE_S)
        assert not reply.success
        assert "/left/old has another definition of the request" in reply.message
