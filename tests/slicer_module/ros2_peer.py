"""Independent ROS process with plain rclpy, controlled by lines of JSON on its standard input.

It prints one line of JSON for each. It does not import the project.

    /peer parameters        one of every type; `unset` has no value
    /peer/echo              SetBool: replies with the value of the request
    /peer/not_rigid         GetPlan: replies with a pose whose quaternion is zero
    /peer/no_reply          Trigger: never replies
    /peer/lookup            tf2_msgs LookupTransform: source_frame selects how the goal ends
    /robot_state_publisher  another node, with the parameter robot_description

Commands add and remove a node /turtlesim with the parameters and the service /spawn of the program
of that name, which needs a display. Its service has the type std_srvs/srv/Trigger if turtlesim's
messages are not installed.
"""

import json
import os
import sys
import threading
import time
from importlib import import_module

import rclpy
from geometry_msgs.msg import PoseStamped, TransformStamped
from nav_msgs.srv import GetPlan
from rcl_interfaces.msg import ParameterDescriptor
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.executors import MultiThreadedExecutor
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from std_srvs.srv import SetBool, Trigger
from tf2_msgs.action import LookupTransform
from tf2_msgs.msg import TFMessage

from tests.bridge.peers import as_plain, filled, interface

DEADLINE_S = 80.0
"""Ends a hang; less than that of a test, whose message would not name the call."""

try:  # by its name: it is not declared, as a desktop ROS has it
    Spawn = import_module("turtlesim.srv").Spawn
except ImportError:
    Spawn = None

rclpy.init()
node = rclpy.create_node("peer")
robot = rclpy.create_node("robot_state_publisher")
changed = threading.Condition()
publishers = {}
received = {}
turtles = []
requests_of = {}
tf = node.create_publisher(TFMessage, "/tf", QoSProfile(depth=100))

for name, value in {
    "flag": True,
    "count": 7,
    "gain": 1.5,
    "text": "ü",
    "flags": [True, False],
    "counts": [1, -2, 3],
    "gains": [0.5, 2.5],
    "texts": ["a", "b"],
}.items():
    node.declare_parameter(name, value)
node.declare_parameter("unset", descriptor=ParameterDescriptor(dynamic_typing=True))
robot.declare_parameter("robot_description", "")


def wait(ready, error):
    """Wait until ``ready()``; ``error`` is the message of a `TimeoutError`."""
    end_s = time.monotonic() + DEADLINE_S
    with changed:
        while not ready():
            if not changed.wait(0.01) and time.monotonic() > end_s:
                raise TimeoutError(error)


def listen(topic, type, latched=False):
    def on_message(message):
        with changed:
            received[topic].append(as_plain(message))
            changed.notify_all()

    received[topic] = []
    durability = DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE
    node.create_subscription(
        interface(type), topic, on_message, QoSProfile(depth=100, durability=durability)
    )
    if not latched:
        wait(lambda: node.count_publishers(topic) > 0, f"no publisher of {topic}")


def take(topic, count=1):
    wait(lambda: len(received[topic]) >= count, f"{len(received[topic])} messages on {topic}")
    messages, received[topic] = received[topic], []
    return messages


def has_edge(child, x):
    with changed:
        edges = [edge for message in received["/tf"] for edge in message["transforms"]]
    return any(
        edge["child_frame_id"] == child and abs(edge["transform"]["translation"]["x"] - x) < 1e-9
        for edge in edges
    )


def publish(topic, type, messages, best_effort=False):
    if topic not in publishers:
        reliability = ReliabilityPolicy.BEST_EFFORT if best_effort else ReliabilityPolicy.RELIABLE
        publishers[topic] = node.create_publisher(
            interface(type), topic, QoSProfile(depth=100, reliability=reliability)
        )
    publisher = publishers[topic]
    wait(lambda: publisher.get_subscription_count() > 0, f"no subscriber to {topic}")
    for each in messages:
        publisher.publish(filled(interface(type)(), each))


def publish_latched(topic, type, data):
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    publishers[topic] = node.create_publisher(interface(type), topic, latched)
    publishers[topic].publish(filled(interface(type)(), {"data": data}))


def send_tf(edges, age_s=0.0):
    wait(lambda: tf.get_subscription_count() > 0, "no subscriber to /tf")
    now = node.get_clock().now() - rclpy.duration.Duration(nanoseconds=int(age_s * 1e9))
    sent = []
    for parent, child, translation in edges:
        edge = TransformStamped(child_frame_id=child)
        edge.header.frame_id = parent
        edge.header.stamp = now.to_msg()
        edge.transform.translation.x, edge.transform.translation.y = translation[:2]
        edge.transform.translation.z = translation[2]
        sent.append(edge)
    tf.publish(TFMessage(transforms=sent))
    return now.nanoseconds


def set_parameter(name, value, of="peer"):
    (result,) = {"peer": node, "robot": robot, "turtlesim": (turtles or [None])[0]}[
        of
    ].set_parameters([Parameter(name, value=value)])
    return result.successful


def endpoints(topic):
    return [node.count_publishers(topic), node.count_subscribers(topic)]


def qualities(topic):
    """Reliability and durability of the endpoints, publishers first."""
    publishers = node.get_publishers_info_by_topic(topic)
    infos = [*publishers, *node.get_subscriptions_info_by_topic(topic)]
    return [[i.qos_profile.reliability.name, i.qos_profile.durability.name] for i in infos]


def spawn(request, response):
    if isinstance(response, Trigger.Response):
        response.success, response.message = True, "turtle2"
    else:
        response.name = request.name or "turtle2"
    return response


def start_turtlesim():
    turtles.append(rclpy.create_node("turtlesim"))
    for name in ("background_r", "background_g", "background_b"):
        turtles[0].declare_parameter(name, 69)
    turtles[0].create_service(Spawn or Trigger, "/spawn", spawn)
    executor.add_node(turtles[0])
    return Spawn is not None


def stop_turtlesim():
    executor.remove_node(turtles[0])
    turtles.pop().destroy_node()


def has_node(name):
    return name in node.get_node_names()


def clients_of(name):
    return sorted(service for service, _ in node.get_client_names_and_types_by_node(name, "/"))


def wait_until(call, value):
    """Wait until ``call`` returns ``value``, since discovery takes time."""
    found = []

    def same():
        found[:] = [COMMANDS[call["do"]](**{k: v for k, v in call.items() if k != "do"})]
        return found[0] == value

    wait(same, f"{call} does not become {value}")


def echo(request, response):
    response.success, response.message = request.data, "echoed"
    return response


def reply_not_rigid(_, response):
    response.plan.poses = [PoseStamped()]
    response.plan.poses[0].pose.orientation.w = 0.0
    return response


def never_reply(_, __):
    threading.Event().wait()


def call_service(name, type, request):
    client = node.create_client(interface(type), name)
    wait(client.service_is_ready, f"no server of {name}")
    done = client.call_async(filled(interface(type).Request(), request))
    wait(done.done, f"{name} did not reply")
    node.destroy_client(client)
    return as_plain(done.result())


def serve(name, type, reply):
    requests_of[name] = []

    def answer(request, _):
        requests_of[name].append(as_plain(request))
        return filled(interface(type).Response(), reply)

    node.create_service(interface(type), name, answer)


def requests(name):
    return requests_of[name]


def blank(type):
    return as_plain(interface(type).Request())


def run_goal(handle):
    how = handle.request.source_frame
    handle.publish_feedback(LookupTransform.Feedback())
    result = LookupTransform.Result()
    result.transform.child_frame_id = how
    result.transform.transform.translation.x = 0.066
    if how == "not_rigid":
        result.transform.transform.rotation.w = 0.0
    if how == "cancel":
        wait(lambda: handle.is_cancel_requested, "the goal was not cancelled")
        handle.canceled()
    elif how == "abort":
        handle.abort()
    else:
        handle.succeed()
    return result


COMMANDS = {
    each.__name__: each
    for each in (
        call_service,
        serve,
        requests,
        blank,
        listen,
        take,
        has_edge,
        publish,
        publish_latched,
        send_tf,
        set_parameter,
        endpoints,
        qualities,
        has_node,
        start_turtlesim,
        stop_turtlesim,
        clients_of,
        wait_until,
    )
}

node.create_service(SetBool, "~/echo", echo)
node.create_service(GetPlan, "~/not_rigid", reply_not_rigid)
node.create_service(Trigger, "~/no_reply", never_reply, callback_group=ReentrantCallbackGroup())
ActionServer(
    node,
    LookupTransform,
    "~/lookup",
    run_goal,
    cancel_callback=lambda _: CancelResponse.ACCEPT,
    goal_callback=lambda goal: (
        GoalResponse.REJECT if goal.source_frame == "reject" else GoalResponse.ACCEPT
    ),
    callback_group=ReentrantCallbackGroup(),
)
executor = MultiThreadedExecutor(32)  # each call of ~/no_reply keeps one for ever
executor.add_node(node)
executor.add_node(robot)
threading.Thread(target=executor.spin, daemon=True).start()
for line in sys.stdin:
    arguments = json.loads(line)
    try:
        reply = {"done": COMMANDS[arguments.pop("do")](**arguments)}
    except Exception as error:
        reply = {"failed": f"{type(error).__name__}: {error}"}
    print(json.dumps(reply), flush=True)
os._exit(0)  # the thread of ~/no_reply never ends
