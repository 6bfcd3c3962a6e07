"""Independent ROS process that tries to loosen a live session, with plain rclpy.

Re-arms the session first, as its operator. Then it sets looser margins, sends re-arms that must
not work, replaces the tumour by a ball of 1.2 mm, and re-arms with the nonce from before. At last
it re-arms with the present nonce. Prints a line of JSON with each reply and the number of
permissive constraints between the first attack and the last re-arm. It does not import the project.
"""

import json
import sys
import time

import rclpy
from marginguard_msgs.msg import FixtureConstraint
from marginguard_msgs.srv import Rearm, SetStructure, SetTumor, SwitchStructure
from rcl_interfaces.srv import SetParametersAtomically
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile

from tests.bridge.service_calls import tumor

UNKNOWN = FixtureConstraint.UNKNOWN
DEADLINE_S = 60.0


class Peer:
    def __init__(self):
        rclpy.init()
        self.node = rclpy.create_node("peer")
        self.last = None
        self.permissive = 0
        self.node.create_subscription(
            FixtureConstraint, "/marginguard/constraint", self.on_constraint, QoSProfile(depth=1000)
        )
        names = {
            "rearm": Rearm,
            "set_tumor": SetTumor,
            "set_structure": SetStructure,
            "switch_structure": SwitchStructure,
            "set_parameters_atomically": SetParametersAtomically,
        }
        self.clients = {
            name: self.node.create_client(
                kind, f"/marginguard/{name}", qos_profile=QoSProfile(depth=1000)
            )
            for name, kind in names.items()
        }
        for client in self.clients.values():
            assert client.wait_for_service(30.0)

    def on_constraint(self, message):
        self.last = message
        self.permissive += not message.hold

    def call(self, name, request):
        future = self.clients[name].call_async(request)
        rclpy.spin_until_future_complete(self.node, future, timeout_sec=DEADLINE_S)
        return future.result()

    def until(self, accept):
        """Wait for a new constraint that ``accept`` accepts, and return it."""
        end_s = time.monotonic() + DEADLINE_S
        self.last = None
        while self.last is None or not accept(self.last):
            assert time.monotonic() < end_s, f"not accepted: {self.last}"
            rclpy.spin_once(self.node, timeout_sec=0.1)
        return self.last

    def held(self, cause=""):
        """A constraint on hold by ``cause`` that could be re-armed."""
        return self.until(
            lambda message: (
                message.hold
                and message.state != UNKNOWN
                and message.rearm_nonce
                and any(each.startswith(cause) for each in message.hold_causes)
            )
        )

    def rearm(self, seq, nonce):
        return self.call("rearm", Rearm.Request(seq=seq, nonce=nonce))

    def rearm_as_operator(self, cause=""):
        """Re-arm the hold by ``cause``; again where another fault came in between."""
        while True:
            held = self.held(cause)
            if self.rearm(held.seq, held.rearm_nonce).success:
                return

    def report(self, **values):
        print(json.dumps(values), flush=True)


def main() -> int:
    peer = Peer()
    known = peer.until(lambda message: message.state != UNKNOWN)
    if known.hold:
        peer.rearm_as_operator()
    peer.until(lambda message: message.state != UNKNOWN and not message.hold)
    looser = {"stop_mm": 0.5, "stale_after_ms": 10_000.0}
    parameters = [Parameter(name, value=value) for name, value in looser.items()]
    request = SetParametersAtomically.Request(
        parameters=[each.to_parameter_msg() for each in parameters]
    )
    result = peer.call("set_parameters_atomically", request).result
    peer.last = None
    held = peer.held("stop_mm lowered")
    # Constraints that were sent before the set may arrive until the first one on hold.
    peer.permissive = 0
    peer.report(set=result.successful, causes=list(held.hold_causes))
    for seq, nonce in ((2**64 - 1, held.rearm_nonce), (held.seq, 0), (held.seq, 4711)):
        reply = peer.rearm(seq, nonce)
        peer.report(success=reply.success, message=reply.message)
    old = peer.held("stop_mm lowered")
    replaced = peer.call("set_tumor", tumor(0.0012))
    peer.report(tumor=replaced.success, message=replaced.message)
    reply = peer.rearm(old.seq, old.rearm_nonce)
    peer.report(success=reply.success, message=reply.message)
    held = peer.held("tumour replaced")
    reply = peer.rearm(held.seq, old.rearm_nonce)
    peer.report(success=reply.success, message=reply.message)
    peer.report(causes=list(held.hold_causes), permissive=peer.permissive)
    peer.rearm_as_operator("tumour replaced")
    peer.until(lambda message: not message.hold)
    peer.report(freed=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
