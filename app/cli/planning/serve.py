"""Plan for an arm beside a running guard and execute the plans, as other ROS nodes ask.

CONTROL is the control.yaml of the arm, or its folder. The node marginguard_plan serves the action
~/plan (an approach from where the arm stands), the service ~/needle_corridors and the action
~/execute (marginguard_msgs), one request at a time, until a signal. Surfaces, their poses and the
registration are those of the guard; ~/markers shows the last plan in RViz. An approach needs the
joint_limits of CONTROL. For its motion the rules of 'plan execute' hold; ~/cancel stops it. The
action ~/follow_joint_trajectory (control_msgs) executes a trajectory of another planner, such as
MoveIt, after a proof that its path keeps --clearance-mm. The markers of ~/obstacles
(visualization_msgs/MarkerArray: SPHERE, CUBE, CYLINDER, TRIANGLE_LIST) are avoided, too; a motion
stops for a new one if the rest of its path is not proven.

Exit status: 0; 2 on bad input, 130 or 143 after a signal.
"""

import argparse
import math
import threading
import time
from functools import partial
from pathlib import Path

from app.cli.options import number

NAME = "serve"
SUMMARY = "plan and execute for other ROS nodes, beside a guard"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of ``marginguard plan serve``."""
    parser.add_argument("control", type=Path, metavar="CONTROL", help="control.yaml or its folder")
    parser.add_argument(
        "--clearance-mm", type=number, default=5.0, metavar="MM",
        help="distance that a motion of ~/follow_joint_trajectory keeps from all structures "
        "(default: %(default)g)",
    )  # fmt: skip


def run(options: argparse.Namespace) -> int:
    """Serve plans until a signal."""
    from app.cli.process import note_signals
    from app.cli.ros import load_ros
    from app.files.extras import check_installed
    from app.geometry import InputError

    check_installed("ompl", "ruckig")
    clearance_mm: float = options.clearance_mm
    if not 0.0 < clearance_mm < math.inf:
        raise InputError(f"--clearance-mm: is {clearance_mm}; expected a number above 0")
    with note_signals() as received:
        load_ros("which 'plan serve' needs")
        with received.ends_at_once():
            from app.bridge import RosNode
            from app.bridge.guard_scene import GuardScene, PathWatch
            from app.bridge.obstacles import Obstacles
            from app.bridge.plan_execution import ExecutionNode, ExecutionServer
            from app.bridge.planning_server import NODE_NAME, PlanningServer
            from app.bridge.trajectory_server import TrajectoryServer
            from app.cli.process import prompt_process
            from app.control import open_control

            description = open_control(options.control)
        stop, lock = threading.Event(), threading.Lock()
        with RosNode(NODE_NAME) as ros, prompt_process():
            arm = ExecutionNode(ros, description, clock_ns=time.time_ns)
            guard = GuardScene(ros, description, Obstacles(ros))
            watch = partial(PathWatch, description, guard)
            executions = ExecutionServer(ros, arm, lock, watch)
            PlanningServer(ros, description, arm, guard, lock)
            TrajectoryServer(description, arm, executions, guard, lock, clearance_mm=clearance_mm)
            print(f"PLANS for arm {description.arm}; Ctrl-C ends", flush=True)
            received.stops(stop.set)
            stop.wait()  # closing the node cancels the goal, and sends its result
    return received.exit_status
