"""Process of `benchmarks.latency` that sends the links of an arm on tf, rclpy alone.

    python -m benchmarks.latency.robot_sender NAME RATE_HZ WARM_UP_S STOPS MOVE_S REST_S

Serves its description as the parameter robot_description of the node NAME, waits for a subscriber
to /tf, moves one joint STOPS times for MOVE_S with rests of REST_S, sends all links all the time,
and prints the stamps in ns of the first and last frames that count, and of the first frame of each
rest. A frame's stamp is the system's clock when it is created.
"""

import json
import math
import sys
import time

import rclpy
from geometry_msgs.msg import TransformStamped
from rclpy.qos import QoSProfile
from tf2_msgs.msg import TFMessage

LINKS = 7
ROOT = "world"
LINK_M = 0.1
SWEEP_RAD = 0.8
_TIMEOUT_S = 60.0


def urdf() -> str:
    """An arm of `LINKS` boxes."""
    links = "".join(
        f'<link name="link_{number}"><visual><origin xyz="0 0 {LINK_M / 2}"/>'
        f'<geometry><box size="0.03 0.03 {LINK_M}"/></geometry></visual></link>'
        for number in range(LINKS)
    )
    joints = "".join(
        f'<joint name="joint_{number}" type="revolute"><parent link="link_{number - 1}"/>'
        f'<child link="link_{number}"/><origin xyz="0 0 {LINK_M}"/><axis xyz="0 1 0"/>'
        '<limit lower="-3" upper="3" effort="1" velocity="3"/></joint>'
        for number in range(1, LINKS)
    )
    return f'<robot name="arm">{links}{joints}</robot>'


def angle_at(second: float, move_s: float, rest_s: float) -> tuple[float, int, bool]:
    """Angle in rad after ``second``, number of the motion, and True while it rests."""
    number, within_s = divmod(second, move_s + rest_s)
    share = min(within_s / move_s, 1.0)
    back = int(number) % 2 == 1
    return SWEEP_RAD * (1.0 - share if back else share), int(number), share == 1.0


def message(name: str, angle_rad: float, stamp_ns: int) -> TFMessage:
    """All links; each joint has the angle."""
    transforms = []
    for number in range(LINKS):
        edge = TransformStamped(child_frame_id=f"{name}/link_{number}")
        edge.header.frame_id = ROOT if number == 0 else f"{name}/link_{number - 1}"
        edge.header.stamp.sec, edge.header.stamp.nanosec = divmod(stamp_ns, 1_000_000_000)
        if number:
            edge.transform.translation.z = LINK_M
            edge.transform.rotation.y = math.sin(angle_rad / 2.0)
            edge.transform.rotation.w = math.cos(angle_rad / 2.0)
        transforms.append(edge)
    return TFMessage(transforms=transforms)


def main() -> int:
    name, numbers = sys.argv[1], [float(text) for text in sys.argv[2:]]
    rate_hz, warm_up_s, stops, move_s, rest_s = numbers
    rclpy.init()
    node = rclpy.create_node(name)
    node.declare_parameter("robot_description", urdf())
    publisher = node.create_publisher(TFMessage, "/tf", QoSProfile(depth=100))
    print(json.dumps({"port": None}), flush=True)
    until_s = time.monotonic() + _TIMEOUT_S
    while publisher.get_subscription_count() == 0:
        if time.monotonic() > until_s:
            raise RuntimeError(f"no receiver of {name} within {_TIMEOUT_S:.0f} s")
        rclpy.spin_once(node, timeout_sec=0.02)
    begin_s, frame, rests_ns, first_ns, last_ns, sent = time.monotonic(), 0, [], 0, 0, 0
    duration_s = warm_up_s + stops * (move_s + rest_s)
    while frame < duration_s * rate_hz:
        due_s = begin_s + frame / rate_hz
        # Serves the parameter meanwhile.
        while (ahead_s := due_s - time.monotonic()) > 0.0:
            if ahead_s > 0.002 and frame < warm_up_s * rate_hz:
                rclpy.spin_once(node, timeout_sec=0.0)
            time.sleep(min(ahead_s, 0.002))
        second = frame / rate_hz - warm_up_s
        angle_rad, number, rests = angle_at(max(second, 0.0), move_s, rest_s)
        stamp_ns = time.time_ns()
        publisher.publish(message(name, angle_rad, stamp_ns))
        if second >= 0.0:
            first_ns, last_ns, sent = first_ns or stamp_ns, stamp_ns, sent + 1
            if rests and number == len(rests_ns):
                rests_ns.append(stamp_ns)
        frame += 1
    time.sleep(0.3)
    report = {"sent": sent, "counted_from_ns": first_ns, "last_ns": last_ns, "rests_ns": rests_ns}
    print(json.dumps(report), flush=True)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
