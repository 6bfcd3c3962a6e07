"""Simulate a world with physics, in real time, as ROS nodes see robots and a tracker.

WORLD is a world.yaml or its folder. Each arm has the topics of CRTK in its namespace (measured_js,
measured_cp, servo_jv, ...); the tracker publishes on /tracked_transforms and /tf; true poses are on
/tf as truth/NAME. An arm moves by servo_jv of one node alone, stops 30 ms after its last command,
and is in FAULT after an invalid one, a second sender, or when the physics falls more than 30 ms
behind real time, until its service enable is called. Exit status 130 or 143 after a signal, 2 on
bad input and when the physics diverges.
"""

import argparse
import threading
import time
from pathlib import Path

from app.cli.ros import load_bridge, print_reach
from app.cli.signals import note_signals

SUMMARY = "simulate robots, tissue and a tracker with physics, on the ROS graph"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of ``marginguard simulate``."""
    parser.add_argument("world", type=Path, metavar="WORLD", help="world.yaml or its folder")
    parser.add_argument(
        "--no-hand", action="store_true", help="without the scripted hand of the world"
    )


def run(options: argparse.Namespace) -> int:
    """Simulate until a signal comes."""
    with note_signals() as received:
        from app.files.extras import check_installed

        check_installed("mujoco", "coacd")
        load_bridge("which 'simulate' needs")
        print_reach()
        with received.ends_at_once():
            from app.bridge import RosNode
            from app.bridge.simulation import NODE_NAME, RealTime, SimulationNode
            from app.simulation import World, open_world

            description = open_world(options.world)
            world = World(description)
        stop = threading.Event()
        received.stops(stop.set)
        with RosNode(NODE_NAME) as ros:
            node = SimulationNode(ros, description, use_hand=not options.no_hand)
            pace = RealTime(
                world, clock_ns=time.monotonic_ns, host_ns=time.time_ns, wait=time.sleep
            )
            node.serve(pace)
            arms = ", ".join(f"/{each.name}" for each in description.robots) or "none"
            print(f"SIMULATION of {description.name}, arms: {arms}; Ctrl-C ends it", flush=True)
            pace.run(node, stop)
    return received.exit_status
