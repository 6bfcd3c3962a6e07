"""The address of a page: its URL, and the addresses that are refused."""

import re
import socket
from urllib.parse import parse_qs, urlsplit

import pytest

from app.viewer import Address, Role, ViewerError


@pytest.mark.parametrize("host", ["127.0.0.1", "::1", "localhost"])
@pytest.mark.parametrize("token", ["plain", "a&b=c#d e+\N{SNOWMAN}"])
def test_url_has_host_port_and_token(host, token):
    address = Address(host, 0, token, f"{token}2")
    for role, expected in ((Role.OPERATE, token), (Role.VIEW, f"{token}2")):
        url = urlsplit(address.url(8080, role))
        assert (url.hostname, url.port) == (host, 8080)
        assert parse_qs(url.query) == {"token": [expected]}


def test_check_refuses_a_port_in_use_and_leaves_a_free_one_free():
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(ViewerError, match=f"at 127.0.0.1 port {port}: Address already in use"):
            Address("127.0.0.1", port, "token").check()
    address = Address("127.0.0.1", port, "token")
    address.check()
    with socket.create_server(("127.0.0.1", port)):
        pass


@pytest.mark.parametrize(
    ("host", "why"),
    [
        ("192.0.2.1", "Cannot assign requested address"),  # RFC 5737: reserved for documentation
        ("127.0.0.1:80", "not known"),
        ("no such host", "not known"),
        ("\N{SNOWMAN}" * 70, "too long"),
    ],
)
def test_host_of_another_machine_is_refused(host, why):
    message = f"cannot be served at {re.escape(host)} port 0: .*{why}"
    with pytest.raises(ViewerError, match=message):
        Address(host, 0, "token").check()


@pytest.mark.parametrize("port", [-1, 65_536, 10**12])
def test_port_out_of_range_is_refused(port):
    with pytest.raises(ViewerError, match=f"port: {port}; expected 0 .* to 65535"):
        Address("127.0.0.1", port, "token")


def test_empty_host_is_refused():
    with pytest.raises(ViewerError, match="host: empty; expected an address"):
        Address("", 0, "token")
