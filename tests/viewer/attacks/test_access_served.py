"""Requests and connections from outside: without the token, with foreign names, half open."""

import itertools
import socket

import pytest

from app.viewer.access_control import MAX_PENDING
from tests.viewer.attacks.raw_page import connected, raw_page, response, status_of
from tests.viewer.conftest import TOKEN, VIEW_TOKEN

pytestmark = pytest.mark.slow

ADDRESSES = (f"127.0.1.{number}" for number in itertools.count(1))
"""Addresses of this machine, one for each wrong token: their number is limited for an address."""
FOREIGN = ["evil.example", "evil.example:80", "localhost.evil.example", "127.0.0.1.evil.example"]


def parts_of(answer):
    """Status, head and body of a response."""
    head, _, body = answer.partition(b"\r\n\r\n")
    return status_of(answer), head.decode(), body


@pytest.mark.parametrize(
    "path",
    [
        *("/", "/index.html", "/vue.global.js", "/marginguard/main.js", "/marginguard/states.css"),
        *("/screenshot.png", "/report.html", "/paraview/", "/no/such/file"),
    ],
)
@pytest.mark.parametrize(
    "query",
    ["", *(f"?token={each}" for each in ("", "wrong", f"{TOKEN}x", TOKEN[:-1], "%c3%bf", "%ff"))],
)
def test_request_without_the_token_gets_no_content(server, path, query):
    status, head, body = parts_of(response(server, path + query, next(ADDRESSES)))
    assert (status, body) == (403, b"")
    assert "Set-Cookie" not in head


def test_cookie_of_the_token_is_not_the_token(server, target):
    status, head, _ = parts_of(response(server, f"/?token={TOKEN}"))
    fields = dict(line.split(": ", 1) for line in head.splitlines()[1:])
    assert status == 303
    assert TOKEN not in fields["Location"]
    assert {"HttpOnly", "SameSite=Strict"} <= set(fields["Set-Cookie"].split("; "))
    name, _, value = target.operate.partition("=")
    assert TOKEN not in value  # the browser sends it to other ports of the host as well
    wrong = parts_of(response(server, "/index.html", Cookie=f"{name}=wrong"))
    assert (wrong[0], wrong[2]) == (403, b"")


def test_right_cookie_gets_the_page_with_a_policy_against_other_hosts(server, target):
    status, head, body = parts_of(response(server, "/index.html", Cookie=target.operate))
    fields = dict(line.split(": ", 1) for line in head.splitlines()[1:])
    assert status == 200
    assert b"<html" in body
    assert "default-src 'self'" in fields["Content-Security-Policy"]
    assert "http:" not in fields["Content-Security-Policy"]
    assert fields["Cross-Origin-Resource-Policy"] == "same-origin"


@pytest.mark.parametrize(
    ("has_cookie", "origin", "status"),
    [
        (True, None, 101),
        (False, None, 403),
        (False, "", 403),
        *((True, each, 403) for each in ("", "null", "http://evil.example", "file://")),
        *((True, each, 403) for each in ("http://elsewhere.example", "http://127.0.0.1:1")),
    ],
)
def test_socket_opens_for_the_page_only(target, has_cookie, origin, status):
    """An origin of None is that of the page itself."""
    headers = {} if origin is None else {"Origin": origin}
    with raw_page(target.server, target.operate if has_cookie else "", **headers) as page:
        assert page.status == status


def test_server_listens_on_this_machine_only(server):
    assert server.host.startswith("127.0.0.1:")


@pytest.mark.parametrize("host", [*FOREIGN, "", "a@127.0.0.1", "127.0.0.1/x", "[::1", "0x7f.1:80"])
def test_foreign_host_name_is_refused_in_spite_of_the_cookie(target, host):
    """A name of another server that points to this machine (DNS rebinding)."""
    answer = response(target.server, "/index.html", Cookie=target.operate, Host=host)
    assert status_of(answer) in (400, 403)
    assert b"html" not in answer.partition(b"\r\n\r\n")[2]
    assert status_of(response(target.server, f"/?token={TOKEN}", Host=host)) in (400, 403)


def test_wrong_tokens_are_counted_for_each_address(target):
    """Addresses of their own: 127.0.0.1 is that of the other tests."""
    guessing, other = "127.0.0.66", "127.0.0.67"
    statuses = [
        status_of(response(target.server, f"/?token=guess{n}", guessing)) for n in range(14)
    ]
    assert statuses[:10] == [403] * 10
    assert 429 in statuses
    for token in (TOKEN, VIEW_TOKEN):  # shorter than a random one
        assert status_of(response(target.server, f"/?token={token}", guessing)) == 429
        assert status_of(response(target.server, f"/?token={token}", other)) == 303
    # A page that is open stays usable.
    answer = response(target.server, "/index.html", guessing, Cookie=target.operate)
    assert status_of(answer) == 200


def test_half_open_connections_take_no_place_from_a_page(target):
    with target.bounded():
        held: list[socket.socket] = []
        for number in range(3 * MAX_PENDING):
            link = connected(target.server, "127.0.0.68")
            link.sendall(b"GET / HTTP/1.1\r\nHost: 127"[: number % 20])
            held.append(link)
        assert status_of(response(target.server, "/index.html", Cookie=target.view)) == 200
        closed = sum(_is_closed(link) for link in held[: 2 * MAX_PENDING])
        assert closed == 2 * MAX_PENDING
        for link in held:
            link.close()


def _is_closed(link):
    try:
        return link.recv(1) == b""
    except ConnectionResetError:
        return True


@pytest.mark.parametrize(
    "request_text",
    [
        "\r\n\r\n" * 50,
        "GET / HTTP/1.1\r\nHost: 127.0.0.1\r\nX: " + "a" * 20_000 + "\r\n\r\n",
        "GET /" + "a" * 20_000 + " HTTP/1.1\r\n\r\n",
        "GET / HTTP/1.1\r\n" + "".join(f"X{n}: 1\r\n" for n in range(500)) + "\r\n",
        "POST /paraview/ HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: -5\r\n\r\n",
        "GET / HTTP/9.9\r\nHost: 127.0.0.1\r\n\r\n",
        "\x16\x03\x01\x02\x00",
    ],
)
def test_malformed_request_gets_no_content_and_no_trace(target, request_text):
    with target.bounded(), connected(target.server, "127.0.0.69") as link:
        link.sendall(request_text.encode("latin-1"))
        link.shutdown(socket.SHUT_WR)
        try:
            answer = b"".join(iter(lambda: link.recv(65_536), b""))
        except ConnectionResetError:
            answer = b""
        assert answer == b"" or status_of(answer) in (400, 403)
        assert b"Traceback" not in answer
        assert b"<html" not in answer
    assert "Traceback" not in target.log


@pytest.mark.parametrize(
    "path", ["/marginguard/../server.py", "/..%2f..%2fetc/passwd", "/marginguard/%2e%2e/server.py"]
)
def test_files_outside_the_folders_are_not_served(target, path):
    answer = response(target.server, path, Cookie=target.operate)
    assert status_of(answer) in (403, 404)
    assert b"import" not in answer
