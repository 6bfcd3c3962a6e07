"""Process of `benchmarks.faults` that stands for a foreign node on the graph, plain rclpy.

Reads requests as lines of JSON, ``{"do": NAME, ...}``, and prints ``done`` with the system time of
the first message or request, and with the reply of a service. Imports nothing of ``app``.
"""

import json
import sys
import threading
import time

import numpy as np
import rclpy
from geometry_msgs.msg import Point, TransformStamped
from marginguard_msgs.msg import FixtureConstraint
from marginguard_msgs.srv import SetTumor
from rclpy.event_handler import PublisherEventCallbacks
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.serialization import deserialize_message
from shape_msgs.msg import MeshTriangle
from tf2_msgs.msg import TFMessage

from benchmarks.faults.requests import Requests
from benchmarks.harness.peer import emit

NS = 10**9


class Foreign(Requests):
    """The node and its requests."""

    def __init__(self):
        super().__init__(rclpy.create_node("foreign_peer"), timeout_s=120.0)
        self.stopped = threading.Event()

    def publisher(self, kind, topic, qos):
        """A publisher that has a subscriber."""
        matched = threading.Event()
        callbacks = PublisherEventCallbacks(matched=lambda _: matched.set())
        publisher = self.node.create_publisher(kind, topic, qos, event_callbacks=callbacks)
        if not matched.wait(10.0):
            raise RuntimeError(f"{topic} has no subscriber")
        return publisher

    def tf_static(self, parent, child, translation, quaternion):
        """Publish a latched transform (m, xyzw)."""
        qos = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        publisher = self.publisher(TFMessage, "/tf_static", qos)
        ns = time.time_ns()
        message = TransformStamped(child_frame_id=child)
        message.header.frame_id = parent
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(ns, NS)
        to, by = message.transform.translation, message.transform.rotation
        to.x, to.y, to.z = translation
        by.x, by.y, by.z, by.w = quaternion
        publisher.publish(TFMessage(transforms=[message]))
        return {"ns": ns}

    def set_tumor(self, frame, position_m, radius_mm, triangles):
        """Replace the tumour by a ball of about ``triangles`` triangles."""
        request = SetTumor.Request()
        request.header.frame_id = frame
        place = request.pose.position
        place.x, place.y, place.z = position_m
        request.pose.orientation.w = 1.0
        vertices, faces = ball(radius_mm / 1000.0, triangles)
        request.mesh.vertices = [Point(x=x, y=y, z=z) for x, y, z in vertices.tolist()]
        request.mesh.triangles = [MeshTriangle(vertex_indices=face) for face in faces]
        return self.call(SetTumor, "set_tumor", request)

    def constraint(self, raw, instance_id, hz):
        """Publish a captured constraint with present stamps and without hold, until the end."""
        message = deserialize_message(bytes.fromhex(raw), FixtureConstraint)
        message.hold, message.model_id = False, "forged"
        message.instance_id = instance_id or message.instance_id
        publisher = self.publisher(
            FixtureConstraint, "/marginguard/constraint", QoSProfile(depth=1)
        )
        first_ns = time.time_ns()

        def send():
            while not self.stopped.wait(1.0 / hz):
                now_ns = time.time_ns()
                message.seq += 3
                stamp, until = message.header.stamp, message.valid_until
                stamp.sec, stamp.nanosec = divmod(now_ns, NS)
                until.sec, until.nanosec = divmod(now_ns + 60_000_000, NS)
                publisher.publish(message)

        threading.Thread(target=send, daemon=True).start()
        return {"ns": first_ns}


def ball(radius, triangles):
    """Vertices (n, 3) and outward faces (m, 3) of a ball by longitude and latitude."""
    rings = max(4, round((triangles / 4.0) ** 0.5))
    around = 2 * rings
    polar, turn = np.meshgrid(
        np.pi * np.arange(1, rings) / rings, 2.0 * np.pi * np.arange(around) / around, indexing="ij"
    )
    points = np.stack(
        [np.sin(polar) * np.cos(turn), np.sin(polar) * np.sin(turn), np.cos(polar)], axis=-1
    ).reshape(-1, 3)
    vertices = radius * np.vstack([[0.0, 0.0, 1.0], points, [0.0, 0.0, -1.0]])
    i, last = np.arange(around), len(vertices) - 1
    j = (i + 1) % around
    start = 1 + around * np.arange(rings - 2)[:, None]
    a, b = (start + i).ravel(), (start + j).ravel()
    parts = (
        (np.zeros_like(i), 1 + i, 1 + j),
        (np.full_like(i, last), last - around + j, last - around + i),
        (a, a + around, b),
        (b, a + around, b + around),
    )
    return vertices, np.concatenate([np.column_stack(part) for part in parts]).astype(np.uint32)


def main():
    rclpy.init()
    foreign = Foreign()
    threading.Thread(target=lambda: rclpy.spin(foreign.node), daemon=True).start()
    emit("ready")
    for line in sys.stdin:
        request = json.loads(line)
        try:
            reply = getattr(foreign, request.pop("do"))(**request)
        except RuntimeError as error:
            reply = {"ns": time.time_ns(), "success": False, "message": str(error)}
        emit("done", reply_ns=time.time_ns(), **reply)
    foreign.stopped.set()
    rclpy.shutdown()


if __name__ == "__main__":
    main()
