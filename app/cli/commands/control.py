"""Move an arm by a hand's force, within the constraint of a guard: a cooperative controller.

FILE is a control.yaml or its folder. Reads joints and the hand's wrench of an arm with CRTK's
topics (measured_js, body/measured_cf), the constraint of 'marginguard live', and the tumour's pose
from the tracker; sends joint velocities (servo_jv) 200 times per second. The arm stands where one
of them is missing, too old, invalid or has two senders. After 30 ms without a valid constraint the
stop is latched until an operator ends it with 'marginguard control --rearm' in another terminal,
which calls the service ~/rearm (std_srvs/Trigger) of the node marginguard_control. It must be the
only sender on servo_jv. With 'impedance' in FILE an arm that closes the loop itself (dVRK) gets the
nearest plane on servo_ci instead, and 'pause' on state_command where no motion is allowed. Exit
status 130 or 143 after a signal, 2 on bad input; of --rearm 0, and 1 if it is refused.
"""

import argparse
import threading
import time
from pathlib import Path

from app.cli.process import note_signals, prompt_process
from app.cli.ros import load_ros
from app.geometry import InputError

CALL_TIMEOUT_S = 10.0

SUMMARY = "move an arm by a hand's force, within the constraint of a guard"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of ``marginguard control``."""
    parser.add_argument(
        "file", type=Path, nargs="?", metavar="FILE", help="control.yaml or its folder"
    )
    parser.add_argument(
        "--rearm",
        action="store_true",
        help="end the latched stop of the controller that runs in this ROS domain",
    )


def run(options: argparse.Namespace) -> int:
    """Control the arm until a signal comes, or re-arm the controller that runs."""
    if options.rearm is (options.file is not None):
        raise InputError("control: invalid combination of arguments; expected FILE, or --rearm")
    return _rearm() if options.rearm else _control(options.file)


def _rearm() -> int:
    load_ros("which 'control' needs")
    from std_srvs.srv import Trigger

    from app.bridge import RosNode
    from app.bridge.arm_control import NODE_NAME
    from app.bridge.calls import ServiceClient

    with RosNode("marginguard_control_rearm") as ros:
        client = ServiceClient(ros, Trigger, f"/{NODE_NAME}/rearm")
        reply = client.call(Trigger.Request(), CALL_TIMEOUT_S, repeat_s=1.0)
    print("re-armed" if reply.success else f"refused: {reply.message}")
    return 0 if reply.success else 1


def _control(file: Path) -> int:
    with note_signals() as received:
        load_ros("which 'control' needs")
        with received.ends_at_once():
            from app.bridge import RosNode
            from app.bridge.arm_control import NODE_NAME, ControlNode
            from app.control import open_control

            description = open_control(file)
        stop = threading.Event()
        received.stops(stop.set)
        with RosNode(NODE_NAME) as ros:
            node = ControlNode(ros, description, clock_ns=time.time_ns)
            print(
                f"CONTROL of {description.name}, arm {description.arm}; Ctrl-C ends it", flush=True
            )
            with prompt_process():
                node.run(stop)
    return received.exit_status
