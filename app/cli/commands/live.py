"""Guard the margin live: what 'replay' does with a file, with samples as they arrive over ROS 2.

A line on standard output tells each change of the state. Runs until SIGINT (exit status 130) or
SIGTERM (143); exit status 2 on bad input.
"""

import argparse
import sys
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from app.cli.options import add_package_dirs
from app.cli.publishing import bridge_loaded, scene_of
from app.cli.signals import Received, note_signals

if TYPE_CHECKING:
    from app.bridge.live import Source
    from app.case import Case, LiveCase
    from app.session import LiveSession, SessionSetup, StepResult

SUMMARY = "guard the margin live, with samples as they arrive over ROS 2"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of ``marginguard live``."""
    parser.add_argument(
        "--config", type=Path, required=True, metavar="FILE", help="live.yaml: docs/live.md"
    )
    add_package_dirs(parser)
    parser.add_argument("--namespace", default="", metavar="NS", help="ROS namespace of the node")
    parser.add_argument(
        "--constraint-hz",
        type=float,
        default=1000.0,
        metavar="HZ",
        help="how often the constraint is repeated, up to 1000; default: 1000",
    )
    parser.add_argument(
        "--tip-only", action="store_true", help="check the tool's tip instead of its whole mesh"
    )


def run(options: argparse.Namespace) -> int:
    """Step and publish until a signal comes."""
    with note_signals() as received:
        _guard(options, received)
    return received.exit_status


def _guard(options: argparse.Namespace, received: Received) -> None:
    from app.case import TfSourceEntry, open_live
    from app.session import LiveSession, Session, setup_from_case, with_repaired_tumor

    bridge_loaded("a live session is ROS")
    config = open_live(options.config, package_dirs=options.package_dirs)
    case = with_repaired_tumor(config.case)
    for note in case.notes():
        print(note, file=sys.stderr)
    setup = setup_from_case(case, tip_only=options.tip_only)
    entry = config.source
    live = LiveSession(
        Session(setup),
        host_ns=_host_clock(config.stamps_of_host),
        stamps_of_host=config.stamps_of_host,
        edges=entry.edges if isinstance(entry, TfSourceEntry) else (),
    )
    received.stops(live.stop)
    _follow(config, case, setup, live, options)


def _host_clock(stamps_of_host: bool) -> Callable[[], int]:
    """ROS time where stamps are of this host; otherwise one that NTP does not set back."""
    if stamps_of_host:
        return time.time_ns
    began_ns = time.time_ns() - time.monotonic_ns()
    return lambda: began_ns + time.monotonic_ns()


def _follow(
    config: "LiveCase",
    case: "Case",
    setup: "SessionSetup",
    live: "LiveSession",
    options: argparse.Namespace,
) -> None:
    from app.bridge import SessionPublisher, Voice
    from app.bridge.control import (
        MarginParameterServer,
        OperatorServices,
        SessionChanges,
        TwistLimiter,
    )
    from app.bridge.live import RearmService, listen_to_joints, source_of
    from app.bridge.tf import TransformBuffer
    from app.bridge.tf.listener import TfListener
    from app.case import TfSourceEntry

    counted: list[Callable[[], Mapping[str, int]]] = [live.left_out]
    # What the tracker's and the robot's own nodes say is not said again.
    voice = Voice(clock=False, measured=not isinstance(config.source, TfSourceEntry), robot=False)
    scene = scene_of(case, setup, tip_only=options.tip_only, with_robot=False)
    with SessionPublisher(
        scene,
        namespace=options.namespace,
        heartbeat_hz=options.constraint_hz,
        voice=voice,
        counts=lambda: {name: n for counts in counted for name, n in counts().items()},
    ) as publisher:
        RearmService(publisher.ros, rearm=live.rearm, fault_seq=lambda: publisher.fault_seq)
        changes = SessionChanges(live.between_steps, publisher, scene)
        MarginParameterServer(publisher.ros, setup.margins, changes.set_margins)
        OperatorServices(publisher.ros, changes)
        buffer = TransformBuffer()
        TfListener(publisher.ros, buffer)
        twists = TwistLimiter(publisher.ros, buffer)
        source: Source = source_of(publisher.ros, config.source, live.add)
        counted += [source.counts, lambda: {"callbacks that failed": publisher.ros.failures}]
        robot = case.manifest.robot
        if robot is not None and robot.joint_states is not None:
            offset_ns = case.manifest.clock.offset_robot_to_tracker_ns
            joints = listen_to_joints(publisher.ros, robot.joint_states, offset_ns, live.add_joints)
            counted.append(joints.counts)
        said: object = None
        try:
            for step in live.steps():
                publisher.publish(step)
                twists.allow(step, changes.scene.margins.stale_after_ns)
                state = (step.decision.state, step.decision.reasons)
                if state != said:
                    said = state
                    print(as_line(step), flush=True)
        finally:
            twists.close()
            source.close()


def as_line(step: "StepResult") -> str:
    """State, distance and reasons of a step, for a person who watches."""
    decision = step.decision
    distance = (
        "" if decision.proximity is None else f" {decision.proximity.signed_distance_mm:.2f} mm"
    )
    reasons = ", ".join(str(reason) for reason in decision.reasons)
    return f"{decision.state.name}{distance}: {reasons}"
