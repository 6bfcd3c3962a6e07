"""Time limits of a page's socket, with a real websocket in this process."""

import asyncio

import aiohttp
import pytest
from aiohttp import WSMsgType, web
from aiohttp.test_utils import TestServer

from app.viewer.access_control import ROLE
from app.viewer.address import Role
from app.viewer.messages import page_socket
from app.viewer.messages.checks import Commands
from app.viewer.messages.methods import Methods
from app.viewer.messages.open_pages import OpenPages
from app.viewer.messages.page_socket import PageSocket
from tests.viewer.attacks.raw_page import message
from tests.viewer.messages.test_calls import ServerDouble

pytestmark = pytest.mark.slow

POLICY = 1008
HELLO = message("wslink.hello", {}, id="system:c0:0")


def run(scenario):
    """Run ``scenario`` with a page's socket; the page has a command that fails."""

    async def served():
        commands = Commands()
        commands.add("fail", lambda: 1 / 0)
        methods = Methods(ServerDouble(), commands, "scene", None, lambda page, number: None)
        sockets = PageSocket(OpenPages(), methods)

        async def handle(request):
            request[ROLE] = Role.OPERATE
            return await sockets.handle(request)

        app = web.Application()
        app.router.add_get("/ws", handle)
        async with TestServer(app) as server, aiohttp.ClientSession() as session:
            origin = f"http://{server.host}:{server.port}"
            async with session.ws_connect(server.make_url("/ws"), origin=origin) as socket:
                await asyncio.wait_for(scenario(socket), 120.0)

    asyncio.run(served())


async def closed(socket):
    while (await socket.receive()).type is WSMsgType.BINARY:
        pass
    return socket.close_code


@pytest.mark.parametrize("ping", [False, True])
def test_page_that_does_not_greet_is_disconnected_in_time_in_spite_of_pings(monkeypatch, ping):
    """Time for the greeting does not begin anew with each message."""
    monkeypatch.setattr(page_socket, "HELLO_S", 0.3)

    async def pinging(socket):
        while not socket.closed:
            await socket.ping()
            await asyncio.sleep(0.02)

    async def scenario(socket):
        task = asyncio.create_task(pinging(socket)) if ping else None
        assert await closed(socket) == POLICY
        if task is not None:
            task.cancel()

    run(scenario)


def test_page_that_falls_silent_is_disconnected_in_time(monkeypatch):
    monkeypatch.setattr(page_socket, "SILENCE_S", 0.05)

    async def scenario(socket):
        await socket.send_bytes(HELLO)
        assert (await socket.receive()).type is WSMsgType.BINARY
        assert await closed(socket) == POLICY

    run(scenario)


def test_failure_of_the_server_is_logged_and_not_described(caplog):
    async def scenario(socket):
        await socket.send_bytes(HELLO)
        await socket.receive()
        await socket.send_bytes(message("trame.trigger", "fail", [], {}))
        answer = (await socket.receive()).data
        assert b"the server has failed at this request" in answer
        assert b"division" not in answer
        assert b"Traceback" not in answer

    run(scenario)
    assert "ZeroDivisionError" in caplog.text
