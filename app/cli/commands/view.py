"""Watch a margin in the browser: a recorded case, or, with --live, samples as they arrive.

Prints two URLs of a page on this machine, each with a token. Open the first one; the second one
('view only:') has no controls. Runs until SIGINT (exit status 130) or SIGTERM (143); exit status 2
on bad input.

A live session runs in a process of its own. --config starts it, as 'live' does, and ends it with
this command; if this command is killed, it goes on and guards, and --node shows it again. --node
shows one that runs already, or waits for it.
"""

import argparse
import re
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from app.cli.options import (
    CASE_HELP,
    LIVE_EXAMPLE,
    add_audit,
    add_cases,
    add_namespace,
    add_package_dirs,
    input_argument,
)
from app.cli.page_address import add_address, checked_address, print_urls
from app.cli.signals import SignalState, note_signals

if TYPE_CHECKING:
    from app.files.volume_file import Volume
    from app.viewer import Viewer

SUMMARY = "watch a replay or a live session in the browser"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of ``marginguard view``."""
    parser.add_argument("case", type=input_argument, nargs="?", metavar="CASE", help=CASE_HELP)
    parser.add_argument(
        "--live", action="store_true", help="watch a live session, instead of a CASE"
    )
    parser.add_argument(
        "--config",
        type=input_argument,
        metavar="FILE",
        help=f"live.yaml for --live: docs/live.md; an example: {LIVE_EXAMPLE}",
    )
    parser.add_argument(
        "--node",
        type=_node_name,
        metavar="NAME",
        help="for --live: the running node to show, such as /marginguard, instead of --config",
    )
    add_namespace(parser)
    add_audit(parser)
    add_cases(parser)
    add_package_dirs(parser)
    parser.add_argument(
        "--tip-only",
        action="store_true",
        help="of a CASE: check the tool's tip instead of its whole mesh",
    )
    add_address(parser)
    parser.add_argument(
        "--render",
        choices=("server", "client"),
        default="server",
        help="where the scene is drawn: here, and sent as pictures (default), or in the browser by "
        "WebGL, for machines with a graphics card",
    )
    parser.add_argument(
        "--volume",
        type=input_argument,
        metavar="PATH",
        help="a scan (NRRD, NIfTI, MetaImage, or a folder with one DICOM series) whose RAS axes "
        "are those of the tumour's frame: its cuts through the tool's tip are shown beside the "
        "picture",
    )
    parser.add_argument(
        "--hand",
        metavar="TOPIC",
        help="with --live: the mouse drags the tool; its force, at most 10 N, and 0 when released, "
        "is published on TOPIC (geometry_msgs/WrenchStamped, along the axes of the tool), for "
        "'marginguard control'",
    )
    parser.add_argument(
        "--world",
        metavar="NODE",
        help="with --live: show the bodies that the node NODE of 'marginguard simulate' simulates, "
        "and let operators move, add and remove them",
    )


def run(options: argparse.Namespace) -> int:
    """Serve the page until a signal comes."""
    import asyncio  # every command loads this file

    from app.geometry import InputError

    if options.live is (options.case is not None) or options.live is not (
        (options.config is None) is not (options.node is None)
    ):
        raise InputError(
            "view: invalid combination of arguments; expected CASE, --live and --config FILE, or "
            "--live and --node NAME"
        )
    if options.live and options.tip_only:
        raise InputError("view: --tip-only: a guard measures the whole tool; expected a CASE")
    in_browser = _in_browser(options)
    for name, needed, is_there in (
        ("audit", "--config", options.config is not None),
        ("cases", "--config", options.config is not None),
        ("world", "--live", options.live),
        ("hand", "--live with it, and no --render client", options.live and not in_browser),
    ):
        if getattr(options, name) is not None and not is_there:
            raise InputError(f"view: --{name} is given; expected {needed}")
    with note_signals() as received:
        from app.files.extras import check_installed

        address = checked_address(options)
        # Before the case is stepped through, which takes a while.
        check_installed("slicer", "trame_slicer")
        volume = None
        if options.volume is not None:
            from app.files.volume_file import read_volume

            volume = read_volume(options.volume)
        with _viewer(options, received, volume) as viewer:
            if viewer is None:
                return received.exit_status

            def ready(port: int) -> None:
                received.stops(viewer.stop)
                print_urls(options, address, port)

            asyncio.run(viewer.serve(address, ready))
    return received.exit_status


@contextmanager
def _viewer(
    options: argparse.Namespace, received: SignalState, volume: "Volume | None"
) -> Iterator["Viewer | None"]:
    """The page to be served; None if a signal arrived before there was one."""
    if options.live:
        from app.cli.live_page import live_page

        with live_page(options, received, client=_in_browser(options), volume=volume) as viewer:
            yield viewer
    else:
        from app.cli.replay_page import replay_page, replay_parts

        parts = replay_parts(
            options.case, options.package_dirs, received, tip_only=options.tip_only
        )
        client = _in_browser(options)
        yield None if parts is None else replay_page(parts, client=client, volume=volume)


def _in_browser(options: argparse.Namespace) -> bool:
    return bool(options.render == "client")


def _node_name(text: str) -> str:
    if not re.fullmatch(r"(/?[A-Za-z_][A-Za-z0-9_]*)+", text):
        raise argparse.ArgumentTypeError(f"{text!r}; expected the name of a node: /marginguard")
    return text
