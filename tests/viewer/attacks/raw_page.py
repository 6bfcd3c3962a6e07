"""A websocket client that sends any bytes, as an attacker with a token would."""

import base64
import os
import socket
import struct
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import msgpack

from tests.viewer.conftest import Server

TEXT, BINARY, CLOSE, PING = 1, 2, 8, 9
TIMEOUT_S = 120.0
AREA = "scene"


def message(method: str, /, *args: object, **changed: object) -> bytes:
    """The bytes of a call as a page sends them; ``changed`` replaces parts of it."""
    call = {"wslink": "1.0", "id": "rpc:c1:7", "method": method, "args": list(args), "kwargs": {}}
    content = msgpack.packb({**call, **changed})
    return struct.pack("<III", 1, 0, len(content)) + content


def connected(server: Server, source: str = "127.0.0.1") -> socket.socket:
    """A TCP connection from an address of this machine."""
    host, port = server.host.split(":")
    return socket.create_connection((host, int(port)), TIMEOUT_S, source_address=(source, 0))


def response(server: Server, path: str, source: str = "127.0.0.1", **headers: str) -> bytes:
    """The whole response to a GET; the server closes the connection after it."""
    with connected(server, source) as link:
        fields = {"Host": server.host, "Connection": "close", **headers}
        lines = [f"GET {path} HTTP/1.1", *(f"{name}: {text}" for name, text in fields.items())]
        link.sendall("\r\n".join([*lines, "", ""]).encode())
        return b"".join(iter(lambda: link.recv(65_536), b""))


def status_of(answer: bytes) -> int:
    return int(answer.split(b" ", 2)[1])


def cookie(server: Server, token: str, source: str = "127.0.0.1") -> str:
    """The cookie that a browser gets for ``token``."""
    head = response(server, f"/?token={token}", source).decode()
    return head.partition("Set-Cookie: ")[2].partition(";")[0]


class RawPage:
    """An open websocket; ``greeted`` sockets get everything that is published to pages."""

    def __init__(self, server: Server, cookie: str, **headers: str) -> None:
        self.link = connected(server)
        key = base64.b64encode(os.urandom(16)).decode()
        fields = {
            "Host": server.host,
            "Origin": f"http://{server.host}",
            "Cookie": cookie,
            "Connection": "Upgrade",
            "Upgrade": "websocket",
            "Sec-WebSocket-Version": "13",
            "Sec-WebSocket-Key": key,
            **headers,
        }
        lines = ["GET /ws HTTP/1.1", *(f"{name}: {text}" for name, text in fields.items() if text)]
        self.link.sendall("\r\n".join([*lines, "", ""]).encode())
        self._stream = self.link.makefile("rb")
        self.status = int(self._stream.readline().split()[1])
        self.headers = b"".join(iter(self._stream.readline, b"\r\n"))
        self.close_code: int | None = None

    def frame(
        self, data: bytes, kind: int = BINARY, *, first: int = 0x80, claimed: int | None = None
    ) -> None:
        """Send one frame; ``first`` has its flags, ``claimed`` is the length in its header."""
        size = len(data) if claimed is None else claimed
        short = size if size < 126 else 126 if size < 2**16 else 127
        length = {126: struct.pack(">H", size & 0xFFFF), 127: struct.pack(">Q", size)}
        mask = b"\0\0\0\0"
        head = bytes([first | kind, 0x80 | short]) + length.get(short, b"") + mask
        self.link.sendall(head + data)

    def greet(self) -> "RawPage":
        """Send the greeting of a page."""
        self.frame(message("wslink.hello", {"secret": "wslink-secret"}, id="system:c0:0"))
        self.answer("system:c0:0")
        return self

    def call(self, method: str, *args: object) -> dict[str, Any]:
        """Send a call and return its answer."""
        self.frame(message(method, *args))
        return self.answer("rpc:c1:7")

    def answer(self, message_id: str) -> dict[str, Any]:
        """The next message with this id."""
        return next(each for each in self.messages() if each["id"] == message_id)

    def published(self, topic: str) -> Any:
        """The next value that is published under ``topic``."""
        return next(m for m in self.messages() if m["id"].startswith(f"publish:{topic}"))["result"]

    def messages(self) -> Iterator[dict[str, Any]]:
        """The messages of the server until it closes the socket."""
        while (data := self._next_frame()) is not None:
            yield msgpack.unpackb(data[12:])

    def ended(self) -> int | None:
        """Read until the server closes the socket; return its code, None without one."""
        for _ in self.messages():
            pass
        return self.close_code

    def _next_frame(self) -> bytes | None:
        try:
            while head := self._stream.read(2):
                kind, short = head[0] & 0x0F, head[1]
                wide = {126: 2, 127: 8}.get(short, 0)
                size = int.from_bytes(self._stream.read(wide), "big") if wide else short
                data = self._stream.read(size)
                if kind == CLOSE:
                    self.close_code = int.from_bytes(data[:2], "big")
                    self.frame(data[:2], CLOSE)
                if kind == BINARY:
                    return data
        except (ConnectionResetError, BrokenPipeError):
            pass
        return None

    def close(self) -> None:
        """Close the connection without a closing handshake."""
        self._stream.close()
        self.link.close()


@contextmanager
def raw_page(server: Server, cookie: str, **headers: str) -> Iterator[RawPage]:
    """A websocket with the role of ``cookie``."""
    page = RawPage(server, cookie, **headers)
    try:
        yield page
    finally:
        page.close()
