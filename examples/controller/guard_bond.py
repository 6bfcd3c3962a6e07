"""ROS 2 supervisor: deactivate a lifecycle controller when its guard is lost, as nav2's bond does.

The heartbeat of the bond is the constraint itself, which a live guard repeats at 100 to 1000 Hz:
it proves that the guard's process runs, not only its middleware. The bond forms with the first
constraint. It breaks when none arrives for 500 ms (killed, stopped or disconnected), when one of
another run arrives (the guard was replaced) and when the guard ends. It then deactivates the
controller and stays broken until an operator calls ``guard_bond/form`` (``std_srvs/Trigger``); the
operator activates the controller again, too. The rule of the controller stops the motion earlier,
at its next control step; the bond keeps it from starting again by itself.

    python examples/controller/guard_bond.py --controller /my_controller
"""

import argparse
import signal
import sys
import threading
import time

import rclpy
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from marginguard_msgs.msg import FixtureConstraint
from rclpy.clock import Clock, ClockType
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.signals import SignalHandlerOptions
from std_srvs.srv import Trigger

import marginguard as mg

PERIOD_S = 0.01
TIMEOUT_NS = 500_000_000
RETRY_NS = 500_000_000
NEWEST = QoSProfile(depth=1)


class Bond:
    """Bond to one run of a guard. Times are those of a steady clock, in ns."""

    def __init__(self, timeout_ns: int = TIMEOUT_NS) -> None:
        self.timeout_ns = timeout_ns
        self.instance_id = ""
        self.broken = ""
        self.received_ns = 0

    def receive(self, instance_id: str, ended: bool, now_ns: int) -> None:
        """Take a heartbeat; ``ended``: the guard says that it ends."""
        self.check(now_ns)
        if not self.instance_id and ended:
            return
        if not self.broken and self.instance_id and instance_id != self.instance_id:
            self.broken = f"another guard sends, {instance_id}"
        elif not self.broken and ended:
            self.broken = "the guard has ended"
        if not self.broken:
            self.instance_id = instance_id
        self.received_ns = now_ns

    def check(self, now_ns: int) -> None:
        """Break the bond if the guard is silent."""
        silent_ns = now_ns - self.received_ns
        if self.instance_id and not self.broken and silent_ns > self.timeout_ns:
            self.broken = f"the guard has been silent for {silent_ns / 1e6:.0f} ms"

    def form(self) -> None:
        """Forget the guard; the next constraint forms a new bond. On an operator's request only."""
        self.instance_id, self.broken = "", ""


class GuardBond(Node):
    """Deactivates the lifecycle node ``controller`` while the bond is broken."""

    def __init__(self, controller: str) -> None:
        super().__init__("guard_bond")
        self.bond = Bond()
        self.deactivated = False
        self.next_ns = 0
        self.state = ""
        self.create_subscription(FixtureConstraint, "/marginguard/constraint", self.receive, NEWEST)
        self.create_service(Trigger, "~/form", self.form)
        self.controller = self.create_client(ChangeState, f"{controller}/change_state")
        self.create_timer(PERIOD_S, self.step, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def receive(self, message: FixtureConstraint) -> None:
        """Take a heartbeat."""
        ended = "inactive" in message.reasons
        self.bond.receive(message.instance_id, ended, time.monotonic_ns())

    def form(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Form a bond with the guard that sends now."""
        self.bond.form()
        response.success = True
        return response

    def step(self) -> None:
        """Check the bond; deactivate the controller until it confirms that."""
        now_ns = time.monotonic_ns()
        self.bond.check(now_ns)
        guard = self.bond.instance_id
        state = self.bond.broken or (f"bond to guard {guard}" if guard else "no guard yet")
        if state != self.state:
            self.state = state
            self.get_logger().info(state)
        if not self.bond.broken:
            self.deactivated = False
        elif not self.deactivated and now_ns >= self.next_ns and self.controller.service_is_ready():
            self.next_ns = now_ns + RETRY_NS
            request = ChangeState.Request()
            request.transition.id = Transition.TRANSITION_DEACTIVATE
            self.controller.call_async(request).add_done_callback(self.confirm)

    def confirm(self, reply: rclpy.task.Future) -> None:
        """Note that the controller is inactive; one that refuses is asked again."""
        self.deactivated = bool(self.bond.broken and reply.result() and reply.result().success)
        if self.deactivated:
            self.get_logger().info("the controller is inactive")


def main() -> int:
    """Run the node until it is interrupted."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--controller", required=True, help="name of the lifecycle node")
    print(mg.prepare_ros())  # the nodes on this machine, unless the variables of ROS say else
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    stopped = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stopped.set())
    node = GuardBond(parser.parse_args(rclpy.utilities.remove_ros_args(sys.argv)[1:]).controller)
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    while not stopped.is_set():
        executor.spin_once()  # returns at each check
    rclpy.shutdown()
    return 0


if __name__ == "__main__":
    sys.exit(main())
