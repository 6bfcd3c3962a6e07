"""Options of the address of a page, and the address that they give."""

import argparse
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from app.viewer import Address


def add_address(parser: argparse.ArgumentParser) -> None:
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


def checked_address(options: argparse.Namespace) -> "Address":
    """The address of ``options``, which can be bound now. Raises `MarginGuardError`."""
    from app.geometry import InputError
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


def print_urls(options: argparse.Namespace, address: "Address", port: int) -> None:
    """Print the URL of each role, and open the first one if the options say so."""
    from app.viewer import Role

    url = address.url(port)
    print(url, f"view only: {address.url(port, Role.VIEW)}", sep="\n", flush=True)
    if options.browser:
        import webbrowser

        webbrowser.open(url)
