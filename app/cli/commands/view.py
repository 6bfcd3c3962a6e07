"""Watch a margin in the browser: a recorded case, or, with --live, samples as they arrive.

A folder of cases is listed: open one, compare two, upload more. Each case is replayed once, in a
process of its own.

Prints two URLs of a page on this machine, each with a token. Open the first one; the second one
('view only:') has no controls and uploads nothing. Runs until SIGINT (exit status 130) or SIGTERM
(143); exit status 2 on bad input.

A live session runs in a process of its own. --config starts it, as 'live' does, and ends it with
this command; if this command is killed, it goes on and guards, and --node shows it again. --node
shows one that runs already, or waits for it.
"""

import argparse
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from app.cli.options import (
    CASE_HELP,
    LIVE_EXAMPLE,
    add_audit,
    add_cases,
    add_namespace,
    add_package_dirs,
    add_tool,
    input_argument,
    integer,
)
from app.cli.process import SignalState, note_signals
from app.files.bounded_io import is_file, is_folder
from app.files.extras import check_installed
from app.geometry import InputError

if TYPE_CHECKING:
    from app.viewer import Address, Viewer
    from app.viewer.library_server import LibraryServer
    from app.workflow import ApproachGhost, NeedleGuide


SUMMARY = "watch a replay, a live session or a folder of cases in the browser"

_MAX_UPLOAD_MB = 4096


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of ``marginguard view``."""
    parser.add_argument(
        "case",
        type=input_argument,
        nargs="?",
        metavar="CASE",
        help=f"{CASE_HELP}; or a folder whose folders are cases, such as --cases of a live session",
    )
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
    add_tool(parser)
    parser.add_argument(
        "--tip-only",
        action="store_true",
        help="of a CASE: check the tool's tip instead of its whole mesh",
    )
    _add_address(parser)
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
    parser.add_argument(
        "--approach",
        type=input_argument,
        metavar="PLAN",
        help="JSON of 'plan approach' for the guard's setup: the robot along its way as a ghost",
    )
    parser.add_argument(
        "--needle",
        type=input_argument,
        metavar="PLAN",
        help="JSON of 'plan needle' for the guard's setup: its corridors, and where the tool, as "
        "the needle, is on one of them",
    )
    parser.add_argument(
        "--max-upload-mb",
        type=integer(0, _MAX_UPLOAD_MB, unit=" MB"),
        metavar="N",
        help="of a folder of cases: largest zip file that may be uploaded, up to "
        f"{_MAX_UPLOAD_MB}; 0: none; default: 512",
    )


def run(options: argparse.Namespace) -> int:
    """Serve the page until a signal comes."""
    import asyncio  # every command loads this file

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
    is_library = options.case is not None and _is_library(options.case)
    for name, needed, is_there in (
        ("audit", "--config", options.config is not None),
        ("cases", "--config", options.config is not None),
        ("world", "--live", options.live),
        ("hand", "--live with it, and no --render client", options.live and not in_browser),
        ("volume", "one CASE, or --live", not is_library),
        ("tip_only", "one CASE", not is_library),
        ("approach", "one CASE, or --live", not is_library),
        ("needle", "one CASE, or --live", not is_library),
        ("tool", "one CASE, or --config", not is_library and options.node is None),
        ("render", "one CASE, or --live", not is_library or not in_browser),
        ("max_upload_mb", "a folder of cases", is_library),
    ):
        given = getattr(options, name)
        if given is not None and given is not False and not is_there:
            raise InputError(f"view: --{name.replace('_', '-')} is given; expected {needed}")
    with note_signals() as received:
        address = _checked_address(options)
        # Before the case is stepped through, which takes a while.
        check_installed("slicer", "trame_slicer")
        with _served_page(options, received, is_library=is_library) as page:
            if page is None:
                return received.exit_status

            def ready(port: int) -> None:
                received.stops(page.stop)
                _print_urls(options, address, port)

            asyncio.run(page.serve(address, ready))
    return received.exit_status


@contextmanager
def _served_page(
    options: argparse.Namespace, received: SignalState, *, is_library: bool
) -> Iterator["Viewer | LibraryServer | None"]:
    """The page to be served; None if a signal arrived before there was one."""
    volume = None
    if options.volume is not None:
        from app.files.volume_file import read_volume

        volume = read_volume(options.volume)
    client, plans = _in_browser(options), _plans(options)
    if is_library:
        from app.cli.library_page import library_page

        with library_page(options) as server:
            yield server
    elif options.live:
        from app.cli.live_page import live_page

        with live_page(options, received, client=client, volume=volume, plans=plans) as viewer:
            yield viewer
    else:
        from app.cli.replay_page import replay_page, replay_parts

        parts = replay_parts(
            options.case,
            options.package_dirs,
            received,
            tip_only=options.tip_only,
            tool=options.tool,
        )
        yield (
            None if parts is None else replay_page(parts, client=client, volume=volume, plans=plans)
        )


def _plans(options: argparse.Namespace) -> "tuple[ApproachGhost, NeedleGuide] | None":
    """The plans of the files that are given; without any, None for a recorded case."""
    if not options.live and options.approach is None and options.needle is None:
        return None
    from app.workflow import ApproachGhost, NeedleGuide

    ghost, needle = ApproachGhost(), NeedleGuide()
    if options.approach is not None:
        ghost.read(options.approach)
    if options.needle is not None:
        needle.read(options.needle)
    return ghost, needle


def _is_library(folder: Path) -> bool:
    """True for a folder of cases, and for an empty folder, to which cases can be uploaded."""
    if is_file(folder / "case.yaml") or not is_folder(folder):
        return False
    return any(folder.glob("*/case.yaml")) or not any(folder.iterdir())


def _in_browser(options: argparse.Namespace) -> bool:
    return bool(options.render == "client")


def _node_name(text: str) -> str:
    if not re.fullmatch(r"(/?[A-Za-z_][A-Za-z0-9_]*)+", text):
        raise argparse.ArgumentTypeError(f"{text!r}; expected the name of a node: /marginguard")
    return text


def _add_address(parser: argparse.ArgumentParser) -> None:
    """Add host, port, tokens and whether a browser is opened."""
    parser.add_argument(
        "--host", default="127.0.0.1", help="address to serve at; default: this machine only"
    )
    parser.add_argument(
        "--port",
        type=int,
        default=0,
        metavar="N",
        help="port to serve at; default: 0, a free one",
    )
    parser.add_argument(
        "--token", help="token that opens the page with its controls; default: a random one"
    )
    parser.add_argument(
        "--view-token", help="token that opens the page without controls; default: a random one"
    )
    parser.add_argument(
        "--allow-host",
        action="append",
        default=[],
        metavar="NAME",
        help="host name under which the page may be opened, besides localhost and addresses in "
        "digits; once for each name, e.g. that of a proxy",
    )
    parser.add_argument(
        "--browser",
        action=argparse.BooleanOptionalAction,
        default=False,
        help="open the page at once",
    )


def _checked_address(options: argparse.Namespace) -> "Address":
    """The address of ``options``, which can be bound now. Raises `MarginGuardError`."""
    from app.viewer import Address, new_token

    for name in ("token", "view_token"):
        if getattr(options, name) == "":
            raise InputError(
                f"--{name.replace('_', '-')} is empty; "
                "expected a text, because anybody could open the page"
            )
    address = Address(
        options.host,
        options.port,
        options.token or new_token(),
        options.view_token or new_token(),
        tuple(options.allow_host),
    )
    address.check()
    return address


def _print_urls(options: argparse.Namespace, address: "Address", port: int) -> None:
    """Print the URL of each role, and open the first one if the options say so."""
    from app.viewer import Role

    url = address.url(port)
    print(url, f"view only: {address.url(port, Role.VIEW)}", sep="\n", flush=True)
    if options.browser:
        import webbrowser

        webbrowser.open(url)
