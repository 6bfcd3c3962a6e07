"""Find straight corridors for a needle from the skin to a target, past the forbidden structures of
a case. Prints the plan as JSON.
"""

import argparse
import json
import math
import time
from typing import TYPE_CHECKING

from app.cli.options import add_case, folder_path, frame_name, input_argument, number, output_path

if TYPE_CHECKING:
    from app.planning import NeedleRobot
    from app.runtime import PreparedCase
    from app.session import StepResult

NAME = "needle"
SUMMARY = "straight corridors for a needle, past forbidden structures"

_BEFORE_S = 1.0
"""A session that begins this long before a time knows the poses of that time."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of ``marginguard plan needle``."""
    add_case(parser)
    for name, text in (
        ("--length-mm", "length of the needle that can be inserted"),
        ("--diameter-mm", "its diameter"),
        ("--bend-mm", "lateral deviation of its tip by bending at full length, at most"),
        ("--sigma-mm", "standard deviation of its place at the target along each axis"),
    ):
        parser.add_argument(name, type=number, required=True, metavar="MM", help=text)
    parser.add_argument(
        "--window-mm", type=number, metavar="MM",
        help="for displays: the needle may advance while the target is at most this far from its "
        "planned place; contained in --sigma-mm",
    )  # fmt: skip
    entry = parser.add_mutually_exclusive_group(required=True)
    entry.add_argument(
        "--entry", type=input_argument, metavar="FILE",
        help="surface of the skin in mm (.stl, .ply, .obj), normals outward",
    )  # fmt: skip
    entry.add_argument(
        "--entry-disc", type=number, nargs=7, metavar="N",
        help="disc of entries: centre, outward normal, radius in mm",
    )  # fmt: skip
    parser.add_argument(
        "--entry-frame", type=frame_name, required=True, metavar="FRAME",
        help="frame of the entries, in which the plan is made, as reference",
    )  # fmt: skip
    parser.add_argument(
        "--entry-box", type=number, nargs=6, metavar="MM",
        help="use the skin within this box: its lowest, then its highest corner",
    )  # fmt: skip
    parser.add_argument("--target", metavar="NAME", help="structure to reach (default: the tumour)")
    parser.add_argument(
        "--target-point", type=number, nargs=3, metavar="MM",
        help="point in the frame of that structure, inside it; default: its deepest one and others",
    )  # fmt: skip
    parser.add_argument(
        "--at-s", type=number, metavar="S",
        help="take the poses of the structures at this time of the recording, in seconds from its "
        "first frame; default: where all are known first",
    )  # fmt: skip
    parser.add_argument(
        "--robot", action="store_true",
        help="offer only corridors along which the robot of the case can insert the needle, held "
        "as its tool: the tip at the tool's, along the tool's z axis",
    )  # fmt: skip
    parser.add_argument("--out", type=output_path, metavar="FILE", help="write the JSON there")
    parser.add_argument(
        "--report", type=folder_path, metavar="DIR", help="write the page needle.html there"
    )


def run(options: argparse.Namespace) -> int:
    """Plan the corridors, print or write them."""
    from app import __version__
    from app.files import check_output_path, load_mesh, write_file
    from app.geometry import InputError
    from app.planning import EntryRegion, Needle
    from app.report.needle_page import needle_page
    from app.report.write import check_writable
    from app.runtime import prepare_case
    from app.runtime.content import surface_digest
    from app.workflow import plan_corridors

    if options.out is not None:
        check_output_path(options.out)
    if options.report is not None:
        check_writable(options.report)
    needle = Needle(options.length_mm, options.diameter_mm, options.bend_mm)
    window_mm = options.window_mm
    if window_mm is not None and not 0.0 <= window_mm < math.inf:
        raise InputError(f"--window-mm: is {window_mm}; expected 0 or more")
    frame: str = options.entry_frame
    if options.entry is not None:
        box = options.entry_box and (options.entry_box[:3], options.entry_box[3:])
        skin = load_mesh(options.entry, units="mm", frame=frame)
        region = EntryRegion.of_surface(skin, box_mm=box)
        entry = {"surface_id": surface_digest(skin), "box_mm": options.entry_box}
    elif options.entry_box is not None:
        raise InputError("--entry-box: is of a disc; expected with --entry")
    else:
        disc = options.entry_disc
        region = EntryRegion.of_disc(frame, disc[:3], disc[3:6], disc[6])
        entry = {"disc_mm": disc}
    prepared = prepare_case(options.case, package_dirs=options.package_dirs, tip_only=True)
    content = prepared.content
    surfaces = content.surfaces
    step, at_s = _step_with_poses(prepared, [*surfaces], frame, options.at_s)
    plan, target, forbidden, values = plan_corridors(
        content,
        {each: step.edges.between(frame, each)[0] for each in surfaces},
        region,
        needle,
        target=options.target or "",
        point_mm=options.target_point,
        sigma_mm=options.sigma_mm,
        window_mm=window_mm,
        robot=_robot(prepared, step, frame) if options.robot else None,
    )
    inputs = {"version": __version__, "case": content.name, "entry": entry, "poses_at_s": at_s}
    document = inputs | values
    text = json.dumps(document, indent=2, allow_nan=False)
    if options.report is not None:
        page = needle_page(plan, target, forbidden, document)
        options.report.mkdir(parents=True, exist_ok=True)
        write_file(options.report / "needle.html", page.encode())
    if options.out is not None:
        write_file(options.out, f"{text}\n".encode())
        print("\n".join(plan.best.reasons))
    else:
        print(text)
    return 0


def _step_with_poses(
    prepared: "PreparedCase", names: list[str], frame: str, at_s: float | None
) -> "tuple[StepResult, float]":
    """The first step, from ``at_s`` on, and its time; without ``at_s`` the first with all poses."""
    from app.geometry import NS_PER_S, FrameError, InputError
    from app.runtime import ReplayRun

    if at_s is not None and not (math.isfinite(at_s) and at_s >= 0.0):
        raise InputError(f"--at-s: is {at_s}; expected 0 or more")
    first_ns = next(iter(prepared.case.frames())).stamp.ns
    start_s = max((at_s or 0.0) - _BEFORE_S, 0.0)
    why = "the recording ends before"
    run = ReplayRun(prepared, clock_ns=time.monotonic_ns, start_s=start_s)
    for step in run.steps():
        now_s = (step.frame.stamp.ns - first_ns) / NS_PER_S
        if at_s is not None and now_s < at_s:
            continue
        try:
            for each in names:
                step.edges.between(frame, each)
        except FrameError as error:
            why = str(error)
            if at_s is not None:
                break
        else:
            return step, now_s
    raise InputError(
        f"poses at {'any time' if at_s is None else f'{at_s:g} s'}: {why}; expected a time at "
        f"which {', '.join(names)} are known in {frame!r}"
    )


def _robot(prepared: "PreparedCase", step: "StepResult", frame: str) -> "NeedleRobot":
    from app.geometry import InputError
    from app.planning import NeedleRobot

    robot = prepared.content.robot
    if robot is None or robot.registration is None or robot.link_from_tip is None:
        raise InputError(
            "--robot: the case has no robot whose base and tool are known; expected a registered "
            "one with recorded joints"
        )
    frame_from_root = step.edges.between(frame, robot.robot.root_link)[0]
    return NeedleRobot(robot.robot, frame_from_root, robot.link_from_tip)
