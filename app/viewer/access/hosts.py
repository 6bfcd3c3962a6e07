"""Check of a request's Host and Origin headers."""

from collections.abc import Iterable
from ipaddress import ip_address
from urllib.parse import urlsplit

_LOCAL = "localhost"


class AllowedHosts:
    """The host names under which the page may be opened.

    A page of another server can give its own name the address of this machine (DNS rebinding); the
    browser then takes this page for a part of the other one. Such a request has the foreign name in
    its Host header. An address in digits cannot be rebound: it is always allowed, like localhost.
    """

    def __init__(self, names: Iterable[str] = ()) -> None:
        self._names = {_LOCAL, *(name.lower().rstrip(".") for name in names)}

    def allows(self, host_header: str | None) -> bool:
        """True if the request was sent to a name that is allowed. The port does not matter."""
        name = _host_name(f"//{host_header}") if host_header else None
        return name is not None and (name in self._names or _is_address(name))


def is_same_origin(origin: str | None, host_header: str | None) -> bool:
    """True if a page of the origin (scheme, host, port) was served under this Host header.

    The scheme is not compared: a proxy may add TLS.
    """
    if not origin or not host_header:
        return False
    parts = origin.split("://", 1)
    return parts[0] in ("http", "https") and len(parts) == 2 and parts[1] == host_header


def _host_name(url: str) -> str | None:
    """The host of ``url`` in lower case; None if it has user, path or a port that is no number."""
    try:
        parts = urlsplit(url)
        _ = parts.port
    except ValueError:
        return None
    if parts.path or parts.query or parts.fragment or "@" in parts.netloc or not parts.hostname:
        return None
    return parts.hostname.rstrip(".")


def _is_address(name: str) -> bool:
    try:
        ip_address(name)
    except ValueError:
        return False
    return True
