"""List the cases of a folder in the browser, open one in the replay page, compare two, upload more.

Prints two URLs of a page on this machine, each with a token. The second one ('view only:') opens
and uploads nothing. Each case is replayed once, in a process of its own. Runs until SIGINT (exit
status 130) or SIGTERM (143); exit status 2 on bad input.
"""

import argparse

from app.cli.options import add_package_dirs, existing_folder
from app.cli.page_address import add_address, checked_address, print_urls
from app.cli.signals import note_signals

SUMMARY = "list, open, compare and upload the cases of a folder in the browser"

MAX_UPLOAD_MB = 4096


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of ``marginguard library``."""
    parser.add_argument(
        "folder",
        type=existing_folder,
        metavar="FOLDER",
        help="folder whose folders are cases, such as --cases of a live session",
    )
    add_package_dirs(parser)
    add_address(parser)
    parser.add_argument(
        "--max-upload-mb",
        type=_megabytes,
        default=512,
        metavar="N",
        help=f"largest zip file that may be uploaded, up to {MAX_UPLOAD_MB}; 0: none; default: 512",
    )


def _megabytes(text: str) -> int:
    if not text.isascii() or not text.isdecimal() or int(text) > MAX_UPLOAD_MB:
        raise argparse.ArgumentTypeError(f"{text!r} MB; expected 0 to {MAX_UPLOAD_MB}")
    return int(text)


def run(options: argparse.Namespace) -> int:
    """Serve the page until a signal comes."""
    import asyncio  # every command loads this file

    with note_signals() as received:
        from app import __version__
        from app.cli.caches import RESULTS_FOLDER
        from app.cli.case_result import CaseReplays, OpenedPage
        from app.files.extras import check_installed
        from app.fixture.proximity.field_cache import cache_folder
        from app.viewer.case_library import CaseLibrary
        from app.viewer.library_server import LibraryServer

        address = checked_address(options)
        check_installed("slicer", "trame_slicer")
        replays = CaseReplays(options.package_dirs)
        page = OpenedPage(options.host, options.allow_host, options.package_dirs)
        library = CaseLibrary(
            options.folder.absolute(), cache_folder() / RESULTS_FOLDER, replays.result, __version__
        )
        library.start()
        server = LibraryServer(library, page.open, options.max_upload_mb << 20)

        def ready(port: int) -> None:
            received.stops(server.stop)
            print_urls(options, address, port)

        try:
            asyncio.run(server.serve(address, ready))
        finally:
            library.close()
            replays.close()
            page.close()
    return received.exit_status
