"""Plan for an arm beside a running guard and execute the plans, as other ROS nodes ask.

CONTROL is the control.yaml of the arm, or its folder. The node marginguard_plan serves the action
~/plan (an approach from where the arm stands), the service ~/needle_corridors and the action
~/execute (marginguard_msgs), one request at a time, until a signal. Surfaces, their poses and the
registration are those of the guard; ~/markers shows the last plan in RViz. An approach needs the
joint_limits of CONTROL. For its motion the rules of 'plan execute' hold; ~/cancel stops it.

Exit status: 0; 2 on bad input, 130 or 143 after a signal.
"""

import argparse
import threading
import time
from pathlib import Path

NAME = "serve"
SUMMARY = "plan and execute for other ROS nodes, beside a guard"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of ``marginguard plan serve``."""
    parser.add_argument("control", type=Path, metavar="CONTROL", help="control.yaml or its folder")


def run(options: argparse.Namespace) -> int:
    """Serve plans until a signal."""
    from app.cli.ros import load_bridge, print_reach
    from app.cli.signals import note_signals
    from app.files.extras import check_installed

    check_installed("ompl", "ruckig")
    with note_signals() as received:
        load_bridge("which 'plan serve' needs")
        print_reach()
        with received.ends_at_once():
            from app.bridge import RosNode
            from app.bridge.plan_execution import ExecutionNode, ExecutionServer
            from app.bridge.planning_server import NODE_NAME, PlanningServer
            from app.cli.gc_control import prompt_process
            from app.control import open_control

            description = open_control(options.control)
        stop, lock = threading.Event(), threading.Lock()
        with RosNode(NODE_NAME) as ros, prompt_process():
            arm = ExecutionNode(ros, description, clock_ns=time.time_ns)
            ExecutionServer(ros, arm, lock)
            PlanningServer(ros, description, arm, lock)
            print(f"PLANS for arm {description.arm}; Ctrl-C ends", flush=True)
            received.stops(stop.set)
            stop.wait()  # closing the node cancels the goal, and sends its result
    return received.exit_status
