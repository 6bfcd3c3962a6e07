"""The check of tokens, what a wrong one costs, and the Host and Origin headers."""

import asyncio

import aiohttp
import pytest
from aiohttp import web
from aiohttp.test_utils import TestServer

from app.viewer import new_token
from app.viewer.access_control import (
    GUESSES,
    ROLE,
    UNGUESSABLE_CHARS,
    AllowedHosts,
    ConnectionLimits,
    GuessLimit,
    RequestAuthenticator,
    is_same_origin,
)
from app.viewer.address import Role


def run(tokens, scenario):
    """Run ``scenario`` with a function that sends requests to an authenticator with ``tokens``."""

    async def answer(request):
        if request.path == "/fail":
            raise ValueError("secret detail")
        return web.Response(text=request[ROLE].value)

    async def served():
        authenticator = RequestAuthenticator(tokens, AllowedHosts(), ConnectionLimits())
        app = web.Application(middlewares=[authenticator.middleware()])
        app.router.add_get("/{path:.*}", answer)
        jar = aiohttp.CookieJar(unsafe=True)  # cookies of an address in digits
        async with TestServer(app) as server, aiohttp.ClientSession(cookie_jar=jar) as session:

            async def status(path):
                async with session.get(server.make_url(path), allow_redirects=False) as response:
                    return response.status, await response.text()

            await scenario(status)

    asyncio.run(served())


@pytest.mark.parametrize(("long", "status"), [(True, 303), (False, 429)])
def test_random_token_opens_the_page_in_spite_of_wrong_ones(long, status):
    tokens = {role: new_token() if long else f"short-{role.value}" for role in Role}
    assert all(long is (len(token) >= UNGUESSABLE_CHARS) for token in tokens.values())

    async def scenario(get):
        for _ in range(GUESSES):
            assert (await get("/?token=wrong"))[0] == 403
        assert (await get("/?token=wrong"))[0] == 429
        for token in tokens.values():
            assert (await get(f"/?token={token}"))[0] == status

    run(tokens, scenario)


def test_url_that_was_opened_last_decides_the_role():
    async def scenario(get):
        assert await get("/") == (403, "")
        for role, token in ((Role.OPERATE, "one"), (Role.VIEW, "two"), (Role.OPERATE, "one")):
            assert (await get(f"/?token={token}"))[0] == 303
            assert await get("/page") == (200, role.value)

    run({Role.OPERATE: "one", Role.VIEW: "two"}, scenario)


def test_failure_of_a_handler_is_logged_and_not_described(caplog):
    async def scenario(get):
        await get("/?token=one")
        assert await get("/fail") == (500, "")

    run({Role.OPERATE: "one", Role.VIEW: "two"}, scenario)
    assert "secret detail" in caplog.text


S = 1_000_000_000


@pytest.mark.parametrize(
    ("guessing", "same", "other"),
    [
        ("192.0.2.1", "192.0.2.1", "192.0.2.2"),
        ("2001:db8::1", "2001:db8::ffff:2", "2001:db8:0:1::1"),
        (None, None, "192.0.2.2"),
    ],
)
def test_address_is_blocked_after_its_guesses_and_free_again_later(guessing, same, other):
    limit = GuessLimit()
    assert all(limit.wrong(guessing, 0) for _ in range(GUESSES))
    assert not limit.wrong(guessing, 0)
    assert limit.is_blocked(same, 0)
    assert not limit.is_blocked(other, 0)
    assert limit.is_blocked(same, 5 * S)
    assert not limit.is_blocked(same, 7 * S)


def test_number_of_addresses_that_are_remembered_is_limited():
    limit = GuessLimit()
    for number in range(5000):
        limit.wrong(f"10.0.{number // 256}.{number % 256}", 0)
    assert len(limit._limits) == 1024


@pytest.mark.parametrize(
    "host",
    [
        *("127.0.0.1", "127.0.0.1:8080", "10.1.2.3:1", "[::1]:8080", "[2001:db8::1]"),
        *("localhost", "LocalHost:80", "or-3.example", "OR-3.example.:443"),
    ],
)
def test_addresses_localhost_and_given_names_are_allowed(host):
    assert AllowedHosts(["or-3.Example"]).allows(host)


@pytest.mark.parametrize(
    "host",
    [
        *(None, "", ":80", "evil.example", "localhost.evil.example", "or-3.example.evil.example"),
        *("127.0.0.1.evil.example", "a@127.0.0.1", "127.0.0.1:80:80", "127.0.0.1:x", "127.0.0.1/"),
        *("127.0.0.1?a", "127.0.0.1#a", "[::1", "::1]", "2130706433", "0x7f.0.0.1", " 127.0.0.1"),
    ],
)
def test_other_names_are_refused(host):
    assert not AllowedHosts(["or-3.example"]).allows(host)


@pytest.mark.parametrize(
    ("origin", "host", "same"),
    [
        ("http://127.0.0.1:80", "127.0.0.1:80", True),
        ("https://or-3.example", "or-3.example", True),
        ("http://127.0.0.1:81", "127.0.0.1:80", False),
        ("http://evil.example", "127.0.0.1:80", False),
        ("http://127.0.0.1:80.evil.example", "127.0.0.1:80", False),
        ("http://evil.example/127.0.0.1:80", "127.0.0.1:80", False),
        ("file://127.0.0.1:80", "127.0.0.1:80", False),
        ("null", "null", False),
        ("", "", False),
        (None, "127.0.0.1:80", False),
    ],
)
def test_origin_is_compared_with_host_and_port(origin, host, same):
    assert is_same_origin(origin, host) is same
