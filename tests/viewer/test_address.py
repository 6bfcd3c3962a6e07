"""The address of a page: what opens it, and where none can be served."""

import re
import socket
from urllib.parse import parse_qs, urlsplit

import pytest

from app.viewer import Address, ViewerError


@pytest.mark.parametrize("host", ["127.0.0.1", "::1", "localhost"])
@pytest.mark.parametrize("token", ["plain", "a&b=c#d e+\N{SNOWMAN}"])
def test_the_address_can_be_read_back(host, token):
    url = urlsplit(Address(host, 0, token).url(8080))
    assert (url.hostname, url.port) == (host, 8080)
    assert parse_qs(url.query) == {"token": [token]}


def test_a_port_is_free_until_somebody_listens_there():
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(ViewerError, match=f"at 127.0.0.1 port {port}: Address already in use"):
            Address("127.0.0.1", port, "token").check()
    address = Address("127.0.0.1", port, "token")
    address.check()
    with socket.create_server(("127.0.0.1", port)):  # it was left free
        pass


@pytest.mark.parametrize(
    ("host", "why"),
    [
        ("192.0.2.1", "Cannot assign requested address"),  # of nobody, by RFC 5737
        ("127.0.0.1:80", "not known"),
        ("no such host", "not known"),
        ("\N{SNOWMAN}" * 70, "too long"),
    ],
)
def test_a_host_that_is_not_this_machine_is_refused(host, why):
    words = f"cannot be served at {re.escape(host)} port 0: .*{why}"
    with pytest.raises(ViewerError, match=words):
        Address(host, 0, "token").check()


@pytest.mark.parametrize("port", [-1, 65_536, 10**12])
def test_a_port_that_there_is_not_is_refused(port):
    with pytest.raises(ViewerError, match=f"port {port}: 0 .* to 65535 wanted"):
        Address("127.0.0.1", port, "token")


def test_no_host_is_not_every_host():
    with pytest.raises(ViewerError, match="host is empty"):
        Address("", 0, "token")
