"""The websocket of a page: reads its requests within limits, and sends what is meant for it."""

import asyncio
from time import monotonic_ns

from aiohttp import WSCloseCode, WSMessage, WSMsgType, web

from app.geometry import MarginGuardError
from app.viewer.access_control import ROLE, is_same_origin
from app.viewer.log import log
from app.viewer.messages.checks import MessageError, NotDoneError, RefusedError
from app.viewer.messages.methods import HELLO, Methods
from app.viewer.messages.open_pages import (
    MAX_MESSAGE_BYTES,
    OpenPage,
    OpenPages,
    Request,
    decode_request,
    encode_answer,
    encode_error,
)

HELLO_S = 10.0
"""Time for a page's first message."""
SILENCE_S = 60.0
"""A page answers every heartbeat: one that is silent for so long has ended."""
MAX_REFUSALS = 20
"""Refused requests after which a page is disconnected. A page of this server sends none."""
_PING_S = 30.0
"""Time between pings. A page has half of it to answer, which also a long drawing needs."""
_CLOSE_S = 0.5
"""Time for the other end to agree to the end of the connection."""


class PageSocket:
    """Serves the websockets of all pages."""

    def __init__(self, pages: OpenPages, methods: Methods) -> None:
        self._pages = pages
        self._methods = methods
        self._sockets: set[web.WebSocketResponse] = set()

    async def handle(self, request: web.Request) -> web.StreamResponse:
        """Serve one websocket until it is closed. A browser sends the Origin of each one."""
        role = request[ROLE]
        if not is_same_origin(request.headers.get("Origin"), request.headers.get("Host")):
            return web.Response(status=403)
        if not self._pages.has_room(role, monotonic_ns()):
            return web.Response(status=503)
        page = OpenPage(role)
        socket = web.WebSocketResponse(
            max_msg_size=MAX_MESSAGE_BYTES + 1,
            # Compressed messages are refused: a small one may unpack to a large one.
            compress=False,
            autoping=False,
            heartbeat=_PING_S,
            timeout=_CLOSE_S,
        )
        self._pages.add(page)
        self._sockets.add(socket)
        sending = None
        try:
            await socket.prepare(request)
            sending = asyncio.create_task(_send(socket, page))
            await self._read(socket, page)
        except MessageError as error:
            log.warning("%s: disconnected: %s", page.id, error)
            await socket.close(code=WSCloseCode.POLICY_VIOLATION)
        finally:
            self._pages.remove(page)
            self._sockets.discard(socket)
            if sending is not None:
                sending.cancel()
                await asyncio.gather(sending, return_exceptions=True)
        return socket

    async def close(self) -> None:
        """Disconnect all pages."""
        closing = (socket.close(code=WSCloseCode.GOING_AWAY) for socket in tuple(self._sockets))
        await asyncio.gather(*closing, return_exceptions=True)

    async def _read(self, socket: web.WebSocketResponse, page: OpenPage) -> None:
        loop = asyncio.get_running_loop()
        greeting_ends = loop.time() + HELLO_S
        while True:
            timeout_s = SILENCE_S if page.greeted else greeting_ends - loop.time()
            try:
                message = await socket.receive(timeout=max(timeout_s, 0.001))
            except TimeoutError:
                raise MessageError("no request in time; expected one") from None
            if message.type in (WSMsgType.CLOSE, WSMsgType.CLOSING, WSMsgType.CLOSED):
                return
            if message.type is WSMsgType.ERROR:
                return
            self._take(page, message)

    def _take(self, page: OpenPage, message: WSMessage) -> None:
        if not page.limit.take(monotonic_ns()):
            raise MessageError("messages: too many a second; expected fewer")
        if message.type is WSMsgType.PING:
            page.pong(message.data)
        elif message.type is WSMsgType.BINARY:
            self._answer(page, decode_request(message.data))
        elif message.type is not WSMsgType.PONG:
            raise MessageError("message: text; expected binary")

    def _answer(self, page: OpenPage, request: Request) -> None:
        if not page.greeted and request.method != HELLO:
            raise MessageError("first message: a request; expected the greeting")
        extra = self._methods.cost(request.method) - 1.0
        try:
            if not page.limit.take(monotonic_ns(), extra):
                raise RefusedError("request: too many a second; expected fewer")
            frames = encode_answer(
                request.id, self._methods.call(page, request.method, request.args)
            )
        except MessageError:
            raise
        except NotDoneError as error:
            frames = encode_error(request.id, str(error))
        except MarginGuardError as error:
            page.refusals += 1
            log.warning("%s: refused: %s", page.id, error)
            if page.refusals > MAX_REFUSALS:
                raise MessageError(f"refused requests: more than {MAX_REFUSALS}") from error
            frames = encode_error(request.id, str(error))
        except Exception:
            log.exception("%s: request %s", page.id, request.method)
            frames = encode_error(request.id, "the server has failed at this request")
        page.answer(frames)


async def _send(socket: web.WebSocketResponse, page: OpenPage) -> None:
    """Send until cancelled. A page that is sent nothing more covers itself."""
    try:
        await _send_all(socket, page)
    except ConnectionError:
        pass
    except Exception:
        log.exception("%s: sending", page.id)


async def _send_all(socket: web.WebSocketResponse, page: OpenPage) -> None:
    while not socket.closed:
        await page.to_send.wait()
        page.to_send.clear()
        while frames := page.outbox.take():
            for frame in frames:
                await socket.send_bytes(frame)
        if (data := page.take_pong()) is not None:
            await socket.pong(data)
