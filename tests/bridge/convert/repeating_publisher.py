"""Independent ROS process that publishes one message repeatedly with plain rclpy.

    repeating_publisher.py TOPIC TYPE PERIOD_S REPR [best_effort|latched]

REPR is a Python dict of the message's fields, with nested messages as dicts. Prints ``ready``;
ends when it is killed.
"""

import ast
import sys

import rclpy
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from tests.bridge.peers import filled, interface, spin


def main(topic, kind, period_s, fields, delivery=""):
    rclpy.init()
    node = rclpy.create_node("repeating_publisher")
    found = interface(kind)
    qos = QoSProfile(depth=10)
    if delivery == "best_effort":
        qos.reliability = ReliabilityPolicy.BEST_EFFORT
    if delivery == "latched":
        qos.durability = DurabilityPolicy.TRANSIENT_LOCAL
    publisher = node.create_publisher(found, topic, qos)
    message = filled(found(), ast.literal_eval(fields))
    if delivery == "latched":
        publisher.publish(message)
    else:
        node.create_timer(float(period_s), lambda: publisher.publish(message))
    print("ready", flush=True)
    spin(node)


if __name__ == "__main__":
    main(*sys.argv[1:])
