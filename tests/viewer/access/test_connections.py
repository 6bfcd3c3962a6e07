"""Limits on connections, with real sockets."""

import asyncio

import pytest

from app.viewer import access_control
from app.viewer.access_control import MAX_ADMITTED, MAX_PENDING, ConnectionLimits
from app.viewer.address import Role


class Sender(asyncio.Protocol):
    """Test double of a web server: sends ``amount`` bytes, and keeps its connections."""

    made: list["Sender"]

    def __init__(self, amount):
        self.amount = amount
        self.lost = asyncio.Event()
        type(self).made.append(self)

    def connection_made(self, transport):
        self.transport = transport
        transport.write(bytes(self.amount))

    def connection_lost(self, exc):
        self.lost.set()


def run(scenario, amount=0):
    async def served():
        Sender.made = []
        limits = ConnectionLimits()
        loop = asyncio.get_running_loop()
        factory = limits.limited(lambda: Sender(amount))
        server = await loop.create_server(factory, "127.0.0.1", 0)
        try:
            await asyncio.wait_for(scenario(limits, server.sockets[0].getsockname()[1]), 120.0)
        finally:
            server.close()
            for each in Sender.made:
                each.transport.abort()

    asyncio.run(served())


async def opened(port):
    before = len(Sender.made)
    link = await asyncio.open_connection("127.0.0.1", port)
    while len(Sender.made) == before:
        await asyncio.sleep(0.001)
    return link


def test_connection_without_an_admitted_request_is_closed_in_time(monkeypatch):
    monkeypatch.setattr(access_control, "PENDING_S", 0.05)

    async def scenario(limits, port):
        reader, _ = await opened(port)
        admitted_reader, _ = await opened(port)
        admitted = Sender.made[1]
        assert limits.admit(admitted.transport, Role.VIEW)
        with pytest.raises((ConnectionResetError, asyncio.IncompleteReadError)):
            await reader.readexactly(1)
        assert not admitted.lost.is_set()
        assert not admitted_reader.at_eof()

    run(scenario)


def test_client_that_reads_nothing_is_disconnected_in_time(monkeypatch):
    monkeypatch.setattr(access_control, "STALL_S", 0.05)

    async def scenario(limits, port):
        _, writer = await opened(port)
        writer.transport.pause_reading()
        assert limits.admit(Sender.made[0].transport, Role.OPERATE)
        await Sender.made[0].lost.wait()

    run(scenario, amount=64 * 1024 * 1024)


def test_new_connection_closes_the_oldest_that_waits():
    async def scenario(limits, port):
        links = [await opened(port) for _ in range(MAX_PENDING)]
        assert limits.admit(Sender.made[0].transport, Role.VIEW)
        links += [await opened(port), await opened(port)]
        await Sender.made[1].lost.wait()
        assert [each.lost.is_set() for each in Sender.made].count(True) == 1

    run(scenario)


def test_admitted_connections_of_a_role_are_limited_until_they_close():
    async def scenario(limits, port):
        links = []
        for _ in range(MAX_ADMITTED):
            links.append(await opened(port))
            assert limits.admit(Sender.made[-1].transport, Role.VIEW)
            assert limits.admit(Sender.made[-1].transport, Role.VIEW)  # its next request
        links.append(await opened(port))
        assert not limits.admit(Sender.made[-1].transport, Role.VIEW)
        assert limits.admit(Sender.made[-1].transport, Role.OPERATE)
        Sender.made[0].transport.close()
        await Sender.made[0].lost.wait()
        links.append(await opened(port))
        assert limits.admit(Sender.made[-1].transport, Role.VIEW)
        assert not limits.admit(None, Role.VIEW)

    run(scenario)
