"""Senders of `benchmarks.latency`: moving bodies and the links of an arm.

    python -m benchmarks.latency.senders tf|igtl BODIES RATE_HZ WARM_UP_S SECONDS
    python -m benchmarks.latency.senders NAME RATE_HZ WARM_UP_S STOPS MOVE_S REST_S

The first sends bodies. The second, rclpy alone, serves a description as the parameter
robot_description of the node NAME, and moves one joint STOPS times for MOVE_S with rests of REST_S.
Both print ``listening`` with their TCP port (OpenIGTLink), wait for their only receiver, send at
the given rate on an absolute clock, and print ``sent``: the number of frames after the warm-up, the
stamp from which they count, and the stamp of the first frame of each rest. A stamp is the system's
clock when a body or frame is created.
"""

import math
import sys
import threading
import time
from contextlib import ExitStack
from typing import Any

from benchmarks.harness.peer import emit, paced, set_time

NS_PER_S = 10**9
ROOT = "world"
TURN_RAD = 0.01  # rotation of a body per frame
LINKS, LINK_M, SWEEP_RAD = 7, 0.1, 0.8
_TIMEOUT_S = 60.0
_ROUNDING_NS = 10_000  # pyigtl's stamps are floating-point seconds; creating a frame takes longer
_DRAIN_TIME_S = 0.3  # pyigtl sends from its own thread and drops unsent messages when stopped


def body_frames(count: int) -> tuple[str, ...]:
    return tuple(f"body_{number:02d}" for number in range(count))


def body_pose(body: int, frame: int) -> tuple[float, ...]:
    """Pose of the body in `ROOT` at frame number ``frame``."""
    half = 0.5 * TURN_RAD * frame
    return (0.1 * frame, 10.0 * body, 5.0, 0.0, 0.0, math.sin(half), math.cos(half))


class TfOutput:
    """All bodies in one message on ``/tf``, sent as bytes."""

    port = None

    def __init__(self, bodies: int, stack: ExitStack) -> None:
        from app.bridge import RosNode, topics

        self._frames = body_frames(bodies)
        self._topic = topics.TF
        self._ros = stack.enter_context(RosNode("latency_sender"))
        self._publisher = self._ros.publisher(topics.TF)

    def wait_for_receiver(self) -> bool:
        return self._ros.wait_for_subscribers(self._topic, 1, _TIMEOUT_S)

    def send(self, frame: int) -> int:
        """Create and send a frame; returns the stamp of its first body."""
        from app.bridge.tf_poses import TfSample, write_tf_message

        samples = [
            TfSample(ROOT, name, time.time_ns(), body_pose(body, frame))
            for body, name in enumerate(self._frames)
        ]
        self._publisher.publish(write_tf_message(samples))
        return samples[0].stamp_ns


class IgtlOutput:
    """One TRANSFORM message per body, from pyigtl's server."""

    def __init__(self, bodies: int, stack: ExitStack) -> None:
        from pyigtl import OpenIGTLinkServer

        self._frames = body_frames(bodies)
        self._server = OpenIGTLinkServer(port=0, local_server=True)
        stack.callback(self._server.stop)
        self.port: int | None = self._server.server_address[1]

    def wait_for_receiver(self) -> bool:
        """Wait for a client by polling, pyigtl's only interface; False after the timeout."""
        until_s = time.monotonic() + _TIMEOUT_S
        while not self._server.is_connected() and time.monotonic() < until_s:
            time.sleep(0.01)
        return bool(self._server.is_connected())

    def send(self, frame: int) -> int:
        from pyigtl import TransformMessage

        from app.geometry import Transform

        first_ns = 0
        for body, name in enumerate(self._frames):
            stamp_ns = time.time_ns()
            first_ns = first_ns or stamp_ns
            x, y, z, *quaternion = body_pose(body, frame)
            pose = Transform.from_quaternion(quaternion, (x, y, z), target="tracker", source=name)
            message = TransformMessage(pose.matrix, device_name=name, timestamp=stamp_ns / NS_PER_S)
            self._server.send_message(message, wait=False)
        return first_ns


def send_bodies(kind: str, bodies: float, rate_hz: float, warm_up_s: float, seconds: float) -> None:
    from app.bridge import prepare_environment

    prepare_environment()
    warm_up, counted = round(warm_up_s * rate_hz), round(seconds * rate_hz)
    counted_from_ns = 0

    def send(frame: int) -> None:
        nonlocal counted_from_ns
        stamp_ns = output.send(frame)
        if frame == warm_up:
            counted_from_ns = stamp_ns - _ROUNDING_NS

    with ExitStack() as stack:
        output: Any = (IgtlOutput if kind == "igtl" else TfOutput)(int(bodies), stack)
        emit("listening", port=output.port)
        if not output.wait_for_receiver():
            raise RuntimeError(f"no receiver of {kind} within {_TIMEOUT_S:.0f} s")
        paced(warm_up + counted, NS_PER_S / rate_hz, send)
        time.sleep(_DRAIN_TIME_S)
    emit("sent", sent=counted, counted_from_ns=counted_from_ns)


def urdf() -> str:
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


def link_message(name: str, angle_rad: float, stamp_ns: int) -> Any:
    from geometry_msgs.msg import TransformStamped
    from tf2_msgs.msg import TFMessage

    transforms = []
    for number in range(LINKS):
        edge = TransformStamped(child_frame_id=f"{name}/link_{number}")
        edge.header.frame_id = ROOT if number == 0 else f"{name}/link_{number - 1}"
        set_time(edge.header.stamp, stamp_ns)
        if number:
            edge.transform.translation.z = LINK_M
            edge.transform.rotation.y = math.sin(angle_rad / 2.0)
            edge.transform.rotation.w = math.cos(angle_rad / 2.0)
        transforms.append(edge)
    return TFMessage(transforms=transforms)


def send_links(
    name: str, rate_hz: float, warm_up_s: float, stops: float, move_s: float, rest_s: float
) -> None:
    import rclpy
    from tf2_msgs.msg import TFMessage

    rclpy.init()
    node = rclpy.create_node(name)
    node.declare_parameter("robot_description", urdf())
    publisher = node.create_publisher(TFMessage, "/tf", 100)
    threading.Thread(target=rclpy.spin, args=(node,), daemon=True).start()  # serves the parameter
    emit("listening", port=None)
    until_s = time.monotonic() + _TIMEOUT_S
    while publisher.get_subscription_count() == 0:
        if time.monotonic() > until_s:
            raise RuntimeError(f"no receiver of {name} within {_TIMEOUT_S:.0f} s")
        time.sleep(0.02)
    stamps_ns, rests_ns = [], []

    def send(frame: int) -> None:
        second = frame / rate_hz - warm_up_s
        angle_rad, number, rests = angle_at(max(second, 0.0), move_s, rest_s)
        stamp_ns = time.time_ns()
        publisher.publish(link_message(name, angle_rad, stamp_ns))
        if second >= 0.0:
            stamps_ns.append(stamp_ns)
            if rests and number == len(rests_ns):
                rests_ns.append(stamp_ns)

    frames = math.ceil((warm_up_s + stops * (move_s + rest_s)) * rate_hz)
    paced(frames, NS_PER_S / rate_hz, send)
    time.sleep(_DRAIN_TIME_S)
    emit("sent", sent=len(stamps_ns), counted_from_ns=stamps_ns[0], rests_ns=rests_ns)
    rclpy.shutdown()


if __name__ == "__main__":
    what, numbers = sys.argv[1], [float(text) for text in sys.argv[2:]]
    (send_bodies if what in ("tf", "igtl") else send_links)(what, *numbers)
