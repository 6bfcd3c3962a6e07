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
import trimesh
from geometry_msgs.msg import Point, TransformStamped
from marginguard_msgs.msg import FixtureConstraint, SessionContent, SessionStep
from marginguard_msgs.srv import Command, Rearm, SetTumor
from rcl_interfaces.msg import Parameter, ParameterValue
from rcl_interfaces.srv import SetParametersAtomically
from rclpy.event_handler import PublisherEventCallbacks
from rclpy.qos import DurabilityPolicy, QoSProfile, qos_profile_sensor_data
from rclpy.serialization import deserialize_message
from rosgraph_msgs.msg import Clock
from shape_msgs.msg import MeshTriangle
from tf2_msgs.msg import TFMessage

from benchmarks.harness.peer import emit, set_time

DOUBLE = 3  # type of a parameter


class Requests:
    """Calls services of ``/marginguard`` from ``node``, which another thread spins.

    Each call returns the system times before the request and after it was converted and sent, and
    ``success`` and ``message`` of the reply, or that there is none.
    """

    def __init__(self, node, timeout_s):
        self.node = node
        self.timeout_s = timeout_s
        self._clients = {}

    def call(self, kind, name, request, reply_of=lambda reply: (reply.success, reply.message)):
        if name not in self._clients:
            self._clients[name] = self.node.create_client(kind, f"/marginguard/{name}")
        client, done, ns = self._clients[name], threading.Event(), time.time_ns()
        if not client.wait_for_service(min(10.0, self.timeout_s)):
            return {"ns": ns, "sent_ns": ns, "success": False, "message": f"no service {name}"}
        ns = time.time_ns()
        future = client.call_async(request)
        times = {"ns": ns, "sent_ns": time.time_ns()}
        future.add_done_callback(lambda _: done.set())
        if not done.wait(self.timeout_s):
            return {**times, "success": False, "message": f"{name}: no reply"}
        success, message = reply_of(future.result())
        return {**times, "success": success, "message": message}

    def rearm(self, seq, nonce):
        return self.call(Rearm, "rearm", Rearm.Request(seq=seq, nonce=nonce))

    def parameters(self, values):
        """Set parameters that are doubles."""
        parameters = [
            Parameter(name=name, value=ParameterValue(type=DOUBLE, double_value=float(value)))
            for name, value in values.items()
        ]
        return self.call(
            SetParametersAtomically,
            "set_parameters_atomically",
            SetParametersAtomically.Request(parameters=parameters),
            lambda reply: (reply.result.successful, reply.result.reason),
        )


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
        set_time(message.header.stamp, ns)
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
        shape = ball(radius_mm, triangles)
        vertices, faces = shape.vertices / 1000.0, shape.faces.astype(np.uint32)
        request.mesh.vertices = [Point(x=x, y=y, z=z) for x, y, z in vertices.tolist()]
        request.mesh.triangles = [MeshTriangle(vertex_indices=face) for face in faces]
        return self.call(SetTumor, "set_tumor", request)

    def clock(self, topic, hz):
        """Publish the system time on ``topic`` as a simulation would, until `pause`."""
        publisher = self.publisher(Clock, topic, 1)

        def send():
            message = Clock()
            set_time(message.clock, time.time_ns())
            publisher.publish(message)

        return self.repeat(send, hz)

    def repeat(self, send, hz):
        """Call ``send`` ``hz`` times a second until `pause`."""
        first_ns = time.time_ns()

        def run():
            while not self.stopped.wait(1.0 / hz):
                send()

        threading.Thread(target=run, daemon=True).start()
        return {"ns": first_ns}

    def pause(self):
        """End what is published."""
        self.stopped.set()
        return {"ns": time.time_ns()}

    def hang(self, instance_id):
        """Subscribe as a display, send a note, and take neither a message nor the reply."""
        node = self.hung = rclpy.create_node("hung_display")  # that nothing spins
        latched = QoSProfile(depth=20, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        node.create_subscription(SessionContent, "/marginguard/content", print, latched)
        node.create_subscription(SessionStep, "/marginguard/step", print, qos_profile_sensor_data)
        client = node.create_client(Command, "/marginguard/command")
        if not client.wait_for_service(10.0):
            raise RuntimeError("no service command")
        request = Command.Request(node="/hung_display", instance_id=instance_id)
        request.command, request.arguments = "note", '{"text": "from a hung display"}'
        client.call_async(request)
        return {"ns": time.time_ns()}

    def constraint(self, raw, instance_id, hz):
        """Publish a captured constraint with present stamps and without hold, until the end."""
        message = deserialize_message(bytes.fromhex(raw), FixtureConstraint)
        message.hold, message.model_id = False, "forged"
        message.instance_id = instance_id or message.instance_id
        publisher = self.publisher(FixtureConstraint, "/marginguard/constraint", 1)

        def send():
            now_ns = time.time_ns()
            message.seq += 3
            set_time(message.header.stamp, now_ns)
            set_time(message.valid_until, now_ns + 60_000_000)
            publisher.publish(message)

        return self.repeat(send, hz)


def ball(radius_mm, triangles):
    """A closed ball of about ``triangles`` triangles."""
    rings = max(4, round((triangles / 4.0) ** 0.5))
    # Twice the latitudes are made.
    return trimesh.creation.uv_sphere(radius=radius_mm, count=[rings // 2 + 1, 2 * rings])


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
