"""Requests without the token get no content: pages, files, downloads, the socket."""

import asyncio
import itertools

import aiohttp
import pytest

from tests.viewer.conftest import TOKEN

PATHS = [
    "/",
    "/index.html",
    "/vue.global.js",
    "/marginguard/main.js",
    "/marginguard/states.css",
    "/screenshot.png",
    "/report.html",
    "/paraview/",
    "/no/such/file",
]


ADDRESSES = (f"127.0.1.{number}" for number in itertools.count(1))
"""Addresses of this machine, one for each wrong token: their number is limited for an address."""


def response_of(server, path, source="127.0.0.1", **given):
    async def get():
        connector = aiohttp.TCPConnector(local_addr=(source, 0))
        async with aiohttp.ClientSession(connector=connector) as session:
            url = f"http://{server.host}{path}"
            async with session.get(url, allow_redirects=False, **given) as answer:
                return answer.status, await answer.read(), dict(answer.headers)

    return asyncio.run(get())


def entry(server):
    """The cookie that a request with the right token gets; it is not the token."""
    status, _, headers = response_of(server, f"/?token={TOKEN}")
    assert status == 303
    assert TOKEN not in headers["Location"]
    parts = headers["Set-Cookie"].split("; ")
    assert {"HttpOnly", "SameSite=Strict"} <= set(parts)
    name, value = parts[0].split("=", 1)
    assert TOKEN not in value  # the browser sends it to other ports of the host as well
    return {name: value}


@pytest.mark.parametrize("path", PATHS)
@pytest.mark.parametrize(
    "token",
    [
        "",
        "?token=",
        "?token=wrong",
        f"?token={TOKEN}x",
        f"?token={TOKEN[:-1]}",
        "?token=\xff",
        "?token=%ff",
    ],
)
def test_request_without_the_token_gets_no_content(server, path, token):
    status, body, headers = response_of(server, path + token, next(ADDRESSES))
    assert (status, body) == (403, b"")
    assert "Set-Cookie" not in headers


def test_wrong_cookie_gets_no_content(server):
    (name,) = entry(server)
    status, body, _ = response_of(server, "/index.html", cookies={name: "wrong"})
    assert (status, body) == (403, b"")


def test_right_cookie_gets_the_page_with_a_policy_against_other_hosts(server):
    status, body, headers = response_of(server, "/index.html", cookies=entry(server))
    assert status == 200
    assert b"<html" in body
    assert "default-src 'self'" in headers["Content-Security-Policy"]
    assert "http:" not in headers["Content-Security-Policy"]
    assert headers["Cross-Origin-Resource-Policy"] == "same-origin"


@pytest.mark.parametrize(
    ("cookie", "origin", "expected"),
    [
        (False, None, 403),
        (False, "own", 403),
        (True, "http://elsewhere.example", 403),
        (True, "http://127.0.0.1:1", 403),
        (True, "own", 101),
    ],
)
def test_socket_opens_for_the_page_only(server, cookie, origin, expected):
    cookies = entry(server) if cookie else {}
    headers = {}
    if origin is not None:
        headers["Origin"] = f"http://{server.host}" if origin == "own" else origin

    async def connect():
        async with aiohttp.ClientSession(cookies=cookies) as session:
            try:
                async with session.ws_connect(f"ws://{server.host}/ws", headers=headers):
                    return 101
            except aiohttp.WSServerHandshakeError as error:
                return error.status

    assert asyncio.run(connect()) == expected


def test_server_listens_on_this_machine_only(server):
    assert server.host.startswith("127.0.0.1:")
