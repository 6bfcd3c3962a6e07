"""The check of tokens in this process: random tokens, and what a wrong one costs."""

import asyncio

import aiohttp
import pytest
from aiohttp import web
from aiohttp.test_utils import TestServer

from app.viewer import new_token
from app.viewer.access.auth import ROLE, UNGUESSABLE_CHARS, Gate
from app.viewer.access.connections import ConnectionLimits
from app.viewer.access.guesses import GUESSES
from app.viewer.access.hosts import AllowedHosts
from app.viewer.access.role import Role


def run(tokens, scenario):
    """Run ``scenario`` with a function that sends requests to a gate with ``tokens``."""

    async def answer(request):
        if request.path == "/fail":
            raise ValueError("secret detail")
        return web.Response(text=request[ROLE].value)

    async def served():
        gate = Gate(tokens, AllowedHosts(), ConnectionLimits())
        app = web.Application(middlewares=[gate.middleware()])
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
