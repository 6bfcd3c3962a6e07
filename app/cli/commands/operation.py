"""Play a simulated operation with tracked ultrasound on the ROS graph, phase by phase on request.

Writes the new folder DIR: live.yaml with a tip, a tumour and a registration that are not the true
ones, and truth/ with those that are. Then start 'view --live --config DIR/live.yaml' in another
terminal. It sends poses, joints and images in real time, and goes through the phases that standard
input names, one on a line, in any order: pivot, spin, sweep N (the probe rests in image plane N, 0
to 8), touch (eight points), approach, breach, retreat, rest. It prints the phase when its motion
has come to its end; a pivot and a spin go on. Exit status 0 when standard input ends, 2 on bad
input, 130 or 143 after a signal.
"""

import argparse
import sys
import threading
from queue import SimpleQueue

from app.cli.options import folder_path
from app.cli.ros import load_bridge, print_reach
from app.cli.signals import note_signals
from app.cli.standard_input import standard_input

SUMMARY = "play a simulated operation with ultrasound, for a live session"

_MAX_LINE = 80


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of ``marginguard operation``."""
    parser.add_argument("folder", type=folder_path, metavar="DIR", help="new folder")
    parser.add_argument(
        "--seed",
        type=int,
        default=1,
        metavar="N",
        help="seed of tumour, places and noise, 0 or more (%(default)s)",
    )


def run(options: argparse.Namespace) -> int:
    """Send until standard input ends or a signal arrives."""
    with note_signals() as received:
        from app.geometry import InputError

        if options.seed < 0:
            raise InputError(f"--seed is {options.seed}; expected 0 or more")
        load_bridge("which 'operation' needs")
        print_reach()
        with received.ends_at_once():
            from app.bridge import RosNode
            from app.bridge.tracker_publisher import OPERATION_NODE, OperationNode
            from app.synthetic import BASE_FRAME, CAUTERY_TIP_FRAME
            from app.synthetic.motion import TouchArm
            from app.synthetic.operation import RATE_HZ, Operation, operation_truth
            from app.synthetic.operation_files import CONFIG_NAME, IMAGE_TOPIC, write_operation

            truth = operation_truth(options.seed)
            write_operation(options.folder, truth)
            arm = TouchArm(base_frame=BASE_FRAME, tip_frame=CAUTERY_TIP_FRAME)
            operation = Operation(truth, arm, options.seed, lambda phase: print(phase, flush=True))
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
    given = standard_input()
    while line := given.readline(_MAX_LINE):
        if line.strip():
            lines.put(line.decode(errors="replace"))
    stop.set()
