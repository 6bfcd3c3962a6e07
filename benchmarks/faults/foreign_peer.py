"""Process of `benchmarks.faults` that stands for a foreign node on the graph, plain rclpy.

Reads requests as lines of JSON, ``{"do": NAME, ...}``, and prints ``done`` with the system time of
the first message or request, and with the reply of a service. It does not import the project.
"""

import json
import sys
import threading
import time

import numpy as np
import rclpy
from geometry_msgs.msg import Point, TransformStamped
from marginguard_msgs.msg import FixtureConstraint
from marginguard_msgs.srv import Rearm, SetTumor
from rcl_interfaces.msg import Parameter, ParameterValue
from rcl_interfaces.srv import SetParametersAtomically
from rclpy.event_handler import PublisherEventCallbacks
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.serialization import deserialize_message
from shape_msgs.msg import MeshTriangle
from tf2_msgs.msg import TFMessage

NS = 10**9
TIMEOUT_S = 120.0


class Foreign:
    """The node and its requests."""

    def __init__(self):
        self.node = rclpy.create_node("foreign_peer")
        self.stopped = threading.Event()
        self.sent_ns = 0  # when the last request had been converted and sent

    def publisher(self, kind, topic, qos):
        """A publisher that has a subscriber."""
        matched = threading.Event()
        callbacks = PublisherEventCallbacks(matched=lambda _: matched.set())
        publisher = self.node.create_publisher(kind, topic, qos, event_callbacks=callbacks)
        if not matched.wait(10.0):
            raise RuntimeError(f"{topic} has no subscriber")
        return publisher

    def call(self, kind, name, request):
        """Call a service; the time of the request and the reply."""
        client = self.node.create_client(kind, name)
        if not client.wait_for_service(10.0):
            raise RuntimeError(f"no service {name}")
        ns, done = time.time_ns(), threading.Event()
        future = client.call_async(request)
        self.sent_ns = time.time_ns()
        future.add_done_callback(lambda _: done.set())
        if not done.wait(TIMEOUT_S):
            raise RuntimeError(f"{name}: no reply")
        return ns, future.result()

    def tf_static(self, parent, child, translation, quaternion):
        """Publish a latched transform (m, xyzw)."""
        qos = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        publisher = self.publisher(TFMessage, "/tf_static", qos)
        message = TransformStamped()
        message.header.frame_id, message.child_frame_id = parent, child
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(time.time_ns(), NS)
        to, by = message.transform.translation, message.transform.rotation
        to.x, to.y, to.z = translation
        by.x, by.y, by.z, by.w = quaternion
        ns = time.time_ns()
        publisher.publish(TFMessage(transforms=[message]))
        return {"ns": ns}

    def parameters(self, values):
        """Set parameters that are doubles."""
        request = SetParametersAtomically.Request(
            parameters=[
                Parameter(name=name, value=ParameterValue(type=3, double_value=float(value)))
                for name, value in values.items()
            ]
        )
        name = "/marginguard/set_parameters_atomically"
        ns, reply = self.call(SetParametersAtomically, name, request)
        return {"ns": ns, "success": reply.result.successful, "message": reply.result.reason}

    def rearm(self, seq, nonce):
        """Send a request to re-arm."""
        ns, reply = self.call(Rearm, "/marginguard/rearm", Rearm.Request(seq=seq, nonce=nonce))
        return {"ns": ns, "success": reply.success, "message": reply.message}

    def set_tumor(self, frame, position_m, radius_mm, triangles):
        """Replace the tumour by a ball of about ``triangles`` triangles."""
        request = SetTumor.Request()
        request.header.frame_id = frame
        place = request.pose.position
        place.x, place.y, place.z = position_m
        request.pose.orientation.w = 1.0
        vertices, faces = ball(radius_mm / 1000.0, triangles)
        request.mesh.vertices = [Point(x=x, y=y, z=z) for x, y, z in vertices.tolist()]
        request.mesh.triangles = [
            MeshTriangle(vertex_indices=face) for face in faces.astype(np.uint32)
        ]
        ns, reply = self.call(SetTumor, "/marginguard/set_tumor", request)
        outcome = {"success": reply.success, "message": reply.message}
        return {"ns": ns, "sent_ns": self.sent_ns, **outcome}

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
                stamp = message.header.stamp
                stamp.sec, stamp.nanosec = divmod(now_ns, NS)
                until = message.valid_until
                until.sec, until.nanosec = divmod(now_ns + 60_000_000, NS)
                publisher.publish(message)

        threading.Thread(target=send, daemon=True).start()
        return {"ns": first_ns}


def ball(radius, triangles):
    """Vertices (n, 3) and outward faces (m, 3) of a ball by longitude and latitude."""
    rings = max(4, round((triangles / 4.0) ** 0.5))
    around = 2 * rings
    polar = np.pi * np.arange(1, rings) / rings
    angles = 2.0 * np.pi * np.arange(around) / around
    polar, angles = np.meshgrid(polar, angles, indexing="ij")
    points = np.stack(
        [np.sin(polar) * np.cos(angles), np.sin(polar) * np.sin(angles), np.cos(polar)], axis=-1
    ).reshape(-1, 3)
    vertices = radius * np.vstack([[0.0, 0.0, 1.0], points, [0.0, 0.0, -1.0]])
    faces = []
    last = len(vertices) - 1
    for i in range(around):
        j = (i + 1) % around
        faces.append((0, 1 + i, 1 + j))
        faces.append((last, last - around + j, last - around + i))
        for ring in range(rings - 2):
            a, b = 1 + ring * around + i, 1 + ring * around + j
            faces += [(a, a + around, b), (b, a + around, b + around)]
    return vertices, np.array(faces)


def main():
    rclpy.init()
    foreign = Foreign()
    threading.Thread(target=lambda: rclpy.spin(foreign.node), daemon=True).start()
    print(json.dumps({"event": "ready"}), flush=True)
    for line in sys.stdin:
        request = json.loads(line)
        try:
            reply = getattr(foreign, request.pop("do"))(**request)
        except RuntimeError as error:
            reply = {"ns": time.time_ns(), "success": False, "message": str(error)}
        print(json.dumps({"event": "done", "reply_ns": time.time_ns(), **reply}), flush=True)
    foreign.stopped.set()
    rclpy.shutdown()


if __name__ == "__main__":
    main()
