"""Independent ROS process: a joystick, or a haptic device, with the names that real ones use.

Reads a line of JSON for each round: ``{"axes": [...]}``, or ``{"handle_m": [...], "late_s": ...}``;
prints the newest ``/touch/servo_cf`` and how many have come. It does not import the project.
"""

import json
import sys
import threading

import rclpy
from geometry_msgs.msg import PoseStamped, WrenchStamped
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import Joy

from tests.bridge.peers import spin


def main() -> int:
    rclpy.init()
    node = rclpy.create_node("hand_peer")
    seen = {"force": None, "frame": "", "count": 0}

    def take(message):
        force = message.wrench.force
        seen.update(
            force=[force.x, force.y, force.z],
            frame=message.header.frame_id,
            count=seen["count"] + 1,
        )

    node.create_subscription(WrenchStamped, "/touch/servo_cf", take, 100)
    joy = node.create_publisher(Joy, "/joy", qos_profile_sensor_data)
    pose = node.create_publisher(PoseStamped, "/touch/measured_cp", 10)
    threading.Thread(target=spin, args=(node,), daemon=True).start()
    print("ready", flush=True)
    for line in sys.stdin:
        command = json.loads(line)
        now = node.get_clock().now().to_msg()
        if "axes" in command:
            message = Joy(axes=command["axes"])
            message.header.stamp = now
            joy.publish(message)
        if "handle_m" in command:
            message = PoseStamped()
            message.header.stamp, message.header.frame_id = now, "touch_base"
            message.header.stamp.sec -= command.get("late_s", 0)
            point = message.pose.position
            point.x, point.y, point.z = command["handle_m"]
            message.pose.orientation.w = 1.0
            pose.publish(message)
        print(json.dumps(seen), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
