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
import sys
import threading
import time
from contextlib import nullcontext
from pathlib import Path
from queue import SimpleQueue
from typing import TYPE_CHECKING

from app.cli.options import folder_path
from app.cli.parsing import CommandParser
from app.cli.process import note_signals, prompt_process
from app.cli.ros import load_ros
from app.cli.simulated_hand import KINDS, check_hand, keys_to, open_hand
from app.files.bounded_io import is_file, is_folder
from app.files.extras import check_installed
from app.geometry import InputError, join_transform_name

if TYPE_CHECKING:
    from contextlib import AbstractContextManager

    from app.igtl import PoseServer
    from app.simulation import WorldDescription


SUMMARY = "simulate robots, tissue and a tracker, or an operation, on the ROS graph"

CONSTRAINT_HZ = "200"
"""Rate of the constraint that the session repeats: that of the controller, for two cores."""


def add_arguments(parser: CommandParser) -> None:
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
    _add_operation_arguments(
        parser.add_subcommand(
            "operation",
            _run_operation,
            "play a simulated operation with ultrasound, for a live session",
        )
    )


def run(options: argparse.Namespace) -> int:
    """Simulate until a signal comes."""
    with note_signals() as received:
        check_installed("mujoco", "coacd")
        load_ros("which 'simulate' needs")
        with received.ends_at_once():
            from app.bridge import RosNode
            from app.bridge.simulation import NODE_NAME, RealTime, SimulationNode
            from app.cli.child_commands import CommandGroup
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
            _check_names(options.igtl, description)
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
            _pose_server(options.igtl) as server,
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
    has_page = options.view and "control" in options.others
    if options.hand == "page" and not has_page:
        raise InputError("simulate: --hand is page; expected --view and --with control with it")
    return options.hand or ("page" if has_page else "script")


def _commands(options: argparse.Namespace) -> list[tuple[str, ...]]:
    """The commands to start, with their arguments. Raises `InputError` for a missing file."""
    from app.bridge.publishing.session_publisher import NODE_NAME
    from app.bridge.world_client import SIMULATION

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


def _check_names(port: int | None, description: "WorldDescription") -> None:
    """Raise `InputError` for a world whose tracker cannot be sent over OpenIGTLink."""
    from app.igtl.pose_messages import MAX_NAME_BYTES
    from app.simulation import TRACKER_FRAME

    if port is None:
        return
    if not 0 <= port < 1 << 16:
        raise InputError(f"--igtl is {port}; expected a port from 0 to 65535")
    if description.tracker is None:
        raise InputError("--igtl: the world has no tracker; expected one")
    for body in description.tracker.tracked:
        name = join_transform_name(body, TRACKER_FRAME)
        if len(name) > MAX_NAME_BYTES:
            raise InputError(
                f"--igtl: the name {name!r} has {len(name)} characters; expected at most "
                f"{MAX_NAME_BYTES}, as the protocol allows"
            )


def _pose_server(port: int | None) -> "AbstractContextManager[PoseServer | None]":
    """The server on ``port``; None without one."""
    from app.igtl import PoseServer

    return nullcontext() if port is None else PoseServer(port)


_MAX_LINE = 80


def _add_operation_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of ``marginguard simulate operation``."""
    parser.add_argument("folder", type=folder_path, metavar="DIR", help="new folder")
    parser.add_argument(
        "--seed",
        type=int,
        default=1,
        metavar="N",
        help="seed of tumour, places and noise, 0 or more (%(default)s)",
    )


def _run_operation(options: argparse.Namespace) -> int:
    """Play a simulated operation with tracked ultrasound on the ROS graph, phase by phase on
    request.

    Writes the new folder DIR: live.yaml with a tip, a tumour and a registration that are not the
    true ones, and truth/ with those that are. Then start 'view --live --config DIR/live.yaml' in
    another terminal. It sends poses, joints and images in real time, and goes through the phases
    that standard input names, one on a line, in any order: pivot, spin, sweep N (the probe rests in
    image plane N, 0 to 8), touch (eight points), approach, breach, retreat, rest. It prints the
    phase when its motion has come to its end; a pivot and a spin go on. Exit status 0 when standard
    input ends, 2 on bad input, 130 or 143 after a signal.
    """
    with note_signals() as received:
        if options.seed < 0:
            raise InputError(f"--seed is {options.seed}; expected 0 or more")
        load_ros("which 'simulate operation' needs")
        with received.ends_at_once():
            from app.bridge import RosNode
            from app.bridge.tracker_publisher import OPERATION_NODE, OperationNode
            from app.synthetic.motion import TouchArm
            from app.synthetic.operation import RATE_HZ, Operation, operation_truth
            from app.synthetic.operation_files import CONFIG_NAME, IMAGE_TOPIC, write_operation

            truth = operation_truth(options.seed)
            write_operation(options.folder, truth)
            operation = Operation(
                truth, TouchArm(), options.seed, lambda phase: print(phase, flush=True)
            )
        stop, lines = threading.Event(), SimpleQueue[str]()
        received.stops(stop.set)
        threading.Thread(target=_read_input, args=(stop, lines), daemon=True).start()

        def requests() -> None:
            while not lines.empty():
                try:
                    operation.request(lines.get())
                except InputError as error:
                    print(error, file=sys.stderr, flush=True)

        with RosNode(OPERATION_NODE) as ros:
            node = OperationNode(ros, operation.step, RATE_HZ, IMAGE_TOPIC)
            print(f"simulated operation: {options.folder / CONFIG_NAME}", flush=True)
            node.run(stop, requests)
    return received.exit_status


def _read_input(stop: threading.Event, lines: "SimpleQueue[str]") -> None:
    """Pass on the lines of standard input, until its end."""
    while line := sys.stdin.buffer.readline(_MAX_LINE):
        if line.strip():
            lines.put(line.decode(errors="replace"))
    stop.set()
