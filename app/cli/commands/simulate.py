"""Simulate a world with physics, in real time, as ROS nodes see robots and a tracker.

WORLD is a world.yaml or its folder. Each arm has the topics of CRTK in its namespace (measured_js,
measured_cp, operating_state, ...); the tracker publishes on /tracked_transforms and /tf; true poses
are on /tf as truth/NAME. An arm moves by servo_jv, servo_jp, servo_cp, servo_cv and servo_cf of one
node alone, the first one, stops 30 ms after its last command, and is in FAULT after an invalid one,
a command or publisher of another node, or when the physics falls more than 30 ms behind real time,
until its service enable is called. --with and --view start other commands with the live.yaml and
control.yaml beside the world; the physics begins when all of them run, and all end with the first
that ends. The hand on the tool is the script of the world, or a person (--hand):
the mouse on the page, which is the default with a page and a controller; the keys w, a, s, d
(across) and r, f (up, down) of this terminal; a joystick or 3D mouse (sensor_msgs/Joy); or a haptic
device (CRTK: measured_cp in, servo_cf out), whose spring is inside its passivity bound. Exit status
130 or 143 after a signal, 2 on bad input, when the physics diverges and when one of the others
ends.
"""

import argparse
import threading
import time
from pathlib import Path

from app.cli.ros import load_bridge, print_reach
from app.cli.signals import note_signals
from app.cli.simulated_hand import KINDS, check_hand, keys_to, open_hand
from app.cli.simulated_tracker_server import check_names, pose_server

SUMMARY = "simulate robots, tissue and a tracker with physics, on the ROS graph"

CONSTRAINT_HZ = "200"
"""Rate of the constraint that the session repeats: that of the controller, for two cores."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of ``marginguard simulate``."""
    parser.add_argument("world", type=Path, metavar="WORLD", help="world.yaml or its folder")
    parser.add_argument(
        "--hand",
        choices=("script", "page", *KINDS, "none"),
        help="which hand moves the tool: the script of the world, the mouse on the page, keys of "
        "this terminal, the world's hand.joy or hand.device, or none; default: page with --view "
        "and --with control, else script",
    )
    parser.add_argument(
        "--igtl",
        type=int,
        metavar="PORT",
        help="send the tracker's transforms to OpenIGTLink clients of this machine, as PLUS does, "
        "instead of /tracked_transforms and /tf; 0 chooses a free port; without --with and --view",
    )
    parser.add_argument(
        "--clock",
        action="store_true",
        help="publish the time of the states on /clock, 100 Hz, until a guard or another clock is "
        "on the graph; without --with and --view",
    )
    parser.add_argument(
        "--with",
        dest="others",
        action="append",
        choices=("live", "control"),
        default=[],
        help="start the guard ('live') or the controller ('control'), too; once for each",
    )
    parser.add_argument(
        "--view",
        action="store_true",
        help="start the guard ('live') and a page that shows it ('view --live --node')",
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
            from app.cli.command_group import CommandGroup
            from app.cli.prompt_process import prompt_process
            from app.geometry import InputError
            from app.simulation import World, open_world

            commands = _commands(options)
            if options.igtl is not None and commands:
                raise InputError("--igtl with --with or --view; expected one of them")
            if options.clock and commands:
                raise InputError(
                    "--clock with --with or --view; expected one of them: guard and controller use "
                    "the clock of the host"
                )
            description = open_world(options.world)
            check_hand(_hand(options), description)
            check_names(options.igtl, description)
            world = World(description)
        stop = threading.Event()
        failed: list[str] = []

        def ended(name: str, status: int) -> None:
            failed.append(f"'marginguard {name}' ended with status {status}")
            stop.set()

        received.stops(stop.set)
        with (
            CommandGroup(ended) as others,
            RosNode(NODE_NAME) as ros,
            pose_server(options.igtl) as server,
        ):
            for command in commands:
                others.start(*command)
            others.wait_until_ready(stop)
            kind = _hand(options)
            hand = open_hand(kind, ros, description)
            node = SimulationNode(
                ros,
                description,
                use_hand=kind == "script",
                hand=hand,
                send_poses=None if server is None else server.send,
                clock=options.clock,
            )
            with keys_to(hand), prompt_process():
                pace = RealTime(
                    world, clock_ns=time.monotonic_ns, host_ns=time.time_ns, wait=time.sleep
                )
                node.serve(pace)
                arms = ", ".join(f"/{each.name}" for each in description.robots) or "none"
                print(f"SIMULATION of {description.name}, arms: {arms}; Ctrl-C ends it", flush=True)
                if server is not None:
                    print(f"OpenIGTLink: port {server.port} of this machine", flush=True)
                try:
                    pace.run(node, stop)
                finally:
                    node.close()
        if failed and received.number is None:
            raise InputError(f"{failed[0]}; expected it to run until the simulation ends")
    return received.exit_status


def _hand(options: argparse.Namespace) -> str:
    """The hand that moves the tool. Raises `InputError` for that of a page without one."""
    from app.geometry import InputError

    has_page = options.view and "control" in options.others
    if options.hand == "page" and not has_page:
        raise InputError("simulate: --hand is page; expected --view and --with control with it")
    return options.hand or ("page" if has_page else "script")


def _commands(options: argparse.Namespace) -> list[tuple[str, ...]]:
    """The commands to start, with their arguments. Raises `InputError` for a missing file."""
    from app.bridge.publishing.session_publisher import NODE_NAME
    from app.bridge.world_client import SIMULATION
    from app.files.bounded_io import is_file, is_folder
    from app.geometry import InputError

    folder = options.world if is_folder(options.world) else options.world.parent
    found: list[tuple[str, ...]] = []
    if options.view:
        hand: tuple[str, ...] = ()
        if _hand(options) == "page":
            from app.control import open_control

            control = open_control(folder / "control.yaml")
            if not control.hand_in_tool:
                raise InputError(
                    f"{folder / 'control.yaml'}: hand.axes is not tool; expected it for the hand "
                    "of the page"
                )
            hand = ("--hand", control.hand_topic)
        found.append(("view", "--live", "--node", NODE_NAME, "--world", SIMULATION, *hand))
    if options.view or "live" in options.others:
        config = str(folder / "live.yaml")
        found.append(("live", "--config", config, "--constraint-hz", CONSTRAINT_HZ))
    if "control" in options.others:
        found.append(("control", str(folder / "control.yaml")))
    for command in found:
        file = next((each for each in command if each.endswith(".yaml")), None)
        if file is not None and not is_file(Path(file)):
            raise InputError(
                f"{file}: no such file; expected it beside the world, for {command[0]}"
            )
    return found
