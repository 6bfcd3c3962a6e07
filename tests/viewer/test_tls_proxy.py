"""The page behind a proxy with TLS, as `docs/viewer.md` advises for another ``--host``."""

import asyncio
import shutil
import ssl
import subprocess
import threading
from contextlib import contextmanager, suppress

import pytest
from playwright.sync_api import expect

from tests.viewer.conftest import SIZE
from tests.viewer.page_actions import show_frame, wait_until_uncovered
from tests.viewer.test_server_gone import check_lost

pytestmark = pytest.mark.long


@pytest.fixture(scope="module")
def certificate(tmp_path_factory):
    """A self-signed certificate with its key, in one file."""
    openssl = shutil.which("openssl")
    if openssl is None:
        pytest.skip("openssl is missing: apt-get install openssl")
    path = tmp_path_factory.mktemp("tls") / "both.pem"
    key = path.with_name("key.pem")
    options = ["-x509", "-newkey", "rsa:2048", "-nodes", "-days", "1", "-subj", "/CN=127.0.0.1"]
    outputs = ["-keyout", str(key), "-out", str(path)]
    subprocess.run([openssl, "req", *options, *outputs], check=True, capture_output=True)
    path.write_text(key.read_text() + path.read_text())
    return path


class TlsProxyDouble:
    """A test double: a TLS proxy that forwards all bytes."""

    def __init__(self, host, certificate):
        self._behind = host.split(":")
        self._context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
        self._context.load_cert_chain(certificate)
        self._loop = asyncio.new_event_loop()
        self._listening = threading.Event()
        self.port = 0
        self._thread = threading.Thread(target=self._loop.run_until_complete, args=[self._serve()])

    @contextmanager
    def open(self):
        """Listen; yield the port."""
        self._thread.start()
        self._listening.wait()
        try:
            yield self.port
        finally:
            self._loop.call_soon_threadsafe(self._closing.set)
            self._thread.join()
            self._loop.close()

    async def _serve(self):
        self._closing = asyncio.Event()
        server = await asyncio.start_server(self._carry, "127.0.0.1", 0, ssl=self._context)
        self.port = server.sockets[0].getsockname()[1]
        self._listening.set()
        await self._closing.wait()
        server.close()
        others = asyncio.all_tasks() - {asyncio.current_task()}
        for task in others:
            task.cancel()
        await asyncio.gather(*others, return_exceptions=True)

    async def _carry(self, reader, writer):
        behind_reader, behind_writer = await asyncio.open_connection(*self._behind)
        directions = ((reader, behind_writer), (behind_reader, writer))
        try:
            await asyncio.gather(*(_forward(*pair) for pair in directions))
        finally:
            behind_writer.close()
            writer.close()


async def _forward(reader, writer):
    with suppress(ConnectionError, asyncio.CancelledError):
        while part := await reader.read(65_536):
            writer.write(part)
            await writer.drain()
        writer.close()


def test_page_loaded_by_https_uses_an_encrypted_socket_and_is_covered_without_it(
    browser, server, certificate
):
    context = browser.new_context(viewport=SIZE, ignore_https_errors=True)
    page, sockets = context.new_page(), []
    page.on("websocket", lambda socket: sockets.append(socket.url))
    with TlsProxyDouble(server.host, certificate).open() as port:
        page.goto(server.url.replace(f"http://{server.host}", f"https://127.0.0.1:{port}"))
        wait_until_uncovered(page)
        show_frame(page, 0)
        expect(page.locator("#state-label")).to_have_text("CLEAR")
        assert sockets == [f"wss://127.0.0.1:{port}/ws"]
    check_lost(page)
    context.close()
