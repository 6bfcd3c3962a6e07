"""Requests to the guard with plain rclpy: as its operator, and as a foreign node."""

import threading
import time

from marginguard_msgs.srv import Rearm
from rcl_interfaces.msg import Parameter, ParameterValue
from rcl_interfaces.srv import SetParametersAtomically

DOUBLE = 3


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
