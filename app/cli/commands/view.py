"""Watch a margin in the browser: a recorded case, or, with --live, samples as they arrive.

A page of this machine, with a token in its address. Runs until SIGINT (exit status 130) or SIGTERM
(143); exit status 2 on bad input.
"""

import argparse
import asyncio
from pathlib import Path

from app.cli.options import add_package_dirs
from app.cli.signals import Received, note_signals

SUMMARY = "watch a replay or a live session in the browser"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of ``marginguard view``."""
    parser.add_argument(
        "case", type=Path, nargs="?", metavar="CASE", help="folder with a case.yaml, to be replayed"
    )
    parser.add_argument("--live", action="store_true", help="a live session instead of a case")
    parser.add_argument(
        "--config", type=Path, metavar="FILE", help="with --live: live.yaml, docs/live.md"
    )
    add_package_dirs(parser)
    parser.add_argument(
        "--tip-only", action="store_true", help="check the tool's tip instead of its whole mesh"
    )
    parser.add_argument(
        "--host", default="127.0.0.1", help="address to serve at; default: this machine alone"
    )
    parser.add_argument(
        "--port", type=int, default=0, help="0, the default, takes one that is free"
    )
    parser.add_argument("--token", help="what opens the page; default: a random one")
    parser.add_argument("--browser", action="store_true", help="open the page in the browser")


def run(options: argparse.Namespace) -> int:
    """Serve the page until a signal comes."""
    from app.geometry import InputError

    if options.live is not (options.case is None) or options.live is not bool(options.config):
        raise InputError("view takes a CASE, or --live with --config FILE: one of the two")
    with note_signals() as received:
        _view(options, received)
    return received.exit_status


def _view(options: argparse.Namespace, received: Received) -> None:
    from app.cli.viewing import replay_viewer
    from app.viewer import Address, new_token

    address = Address(options.host, options.port, options.token or new_token())
    viewer = replay_viewer(options.case, options.package_dirs, tip_only=options.tip_only)
    received.stops(viewer.stop)

    def ready(url: str) -> None:
        print(url, flush=True)
        if options.browser:
            import webbrowser

            webbrowser.open(url)

    asyncio.run(viewer.serve(address, ready))
