"""Independent ROS process that calls services one after the other and prints the replies.

    caller.py NAME:TYPE:{"field": value} ...

Prints ``ready``, then each reply as a line of JSON. It uses plain rclpy, not the project.

A server drops a reply to a client that it has not discovered, and a client cannot see when it has.
Endpoints are discovered in the order of their creation: so the last client calls a harmless service
of the same node until a reply arrives. Each client receives the replies to all clients; more than
ROS's default of 10 must wait, or a burst of replies to another one drops ours.
"""

import json
import sys

import rclpy
from rcl_interfaces.srv import GetParameters
from rclpy.qos import QoSProfile

from tests.bridge.peers import as_plain, filled, interface

DEADLINE_S = 90.0
QOS = QoSProfile(depth=1000)


def main():
    rclpy.init()
    node = rclpy.create_node("caller")
    calls = [argument.split(":", 2) for argument in sys.argv[1:]]
    kinds = {name: interface(kind) for name, kind, _ in calls}
    clients = {
        name: node.create_client(kind, name, qos_profile=QOS) for name, kind in kinds.items()
    }
    servers = {name.rpartition("/")[0] for name in kinds}
    harmless = [node.create_client(GetParameters, f"{each}/get_parameters") for each in servers]
    for client in (*clients.values(), *harmless):
        assert client.wait_for_service(DEADLINE_S), client.srv_name
    for client in harmless:
        future = None
        while future is None or not future.done():
            future = client.call_async(GetParameters.Request())
            rclpy.spin_until_future_complete(node, future, timeout_sec=1.0)
    print("ready", flush=True)
    for name, _, fields in calls:
        future = clients[name].call_async(filled(kinds[name].Request(), json.loads(fields)))
        rclpy.spin_until_future_complete(node, future, timeout_sec=DEADLINE_S)
        assert future.done(), f"no reply from {name}"
        print(json.dumps(as_plain(future.result())), flush=True)
    node.destroy_node()
    rclpy.shutdown()


if __name__ == "__main__":
    main()
