"""The render loop: draws and sends pictures as often as drawing and the clients allow."""

import asyncio
from collections.abc import Callable, Coroutine
from contextlib import suppress
from time import monotonic_ns
from typing import Protocol

from trame_rca.encoders import RcaImageEncoder

from app.geometry import NS_PER_MS, NS_PER_S
from app.viewer.drawing.area import PictureArea
from app.viewer.drawing.client_acks import ClientAcks
from app.viewer.drawing.frame_rate import MAX_LOAD, FrameRate

_JPEG_QUALITY, _HIGH_JPEG_QUALITY = 75, 92
_HEARTBEAT_NS = 200 * NS_PER_MS
_STILL_NS = 400 * NS_PER_MS
"""After so long without a change the picture is drawn once more in high quality."""

Push = Callable[[bytes, dict[str, object]], None]


class Source(Protocol):
    """Source of a picture."""

    def prepare(self) -> bool:
        """Update the scene to the present; return True if anything changed."""

    def sent(self, number: int) -> None:
        """Picture ``number`` of the scene as it was prepared was sent."""


class RenderScheduler(Protocol):
    """Decides when an area is drawn, and draws it."""

    def schedule_render(self) -> None:
        """Draw, also if the steps have not changed: a camera, a size or a colour has."""

    def wake(self) -> None:
        """Check soon whether there is anything new to draw."""

    def acknowledge(self, client: str, number: int) -> None:
        """Picture ``number`` is the last one that ``client`` has; 0 for a new client."""

    async def run(self) -> None:
        """Draw until cancelled."""


MakeScheduler = Callable[[PictureArea, Source, Callable[[int], None]], RenderScheduler]
"""Makes a scheduler of an area, of what is drawn, and of the function that sends heartbeats."""


class RenderLoop:
    """The page's `RenderScheduler`; also trame's `RcaRenderSchedulerProtocol`.

    The next picture is drawn when one of the active clients has the last one, and shows the newest
    state, as soon as `wake` is called; clients that are slower skip pictures. The loop itself calls
    ``heartbeat`` with the number of the last picture, so that a heartbeat proves that pictures are
    still drawn.
    """

    def __init__(
        self,
        area: PictureArea,
        source: Source,
        heartbeat: Callable[[int], None],
        max_load: float = MAX_LOAD,
    ) -> None:
        self.rca = area
        self.frame_rate = FrameRate(max_load)
        self._acks = ClientAcks()
        self._number = 0
        self._source = source
        self._heartbeat = heartbeat
        self._heartbeat_ns = 0
        self._push: Push | None = None
        self._render_requested = True
        self._wake = asyncio.Event()

    @property
    def target_fps(self) -> float:
        """The present frame rate in Hz."""
        return NS_PER_S / self.frame_rate.period_ns

    @target_fps.setter
    def target_fps(self, value: float) -> None:
        """Ignored: the frame rate follows from the measured cost."""

    def set_push_callback(self, callback: Push) -> None:
        """Send pictures by ``callback``."""
        self._push = callback

    def schedule_render(self) -> None:
        """Draw, also if the steps have not changed: a camera, a size or a colour has."""
        self._render_requested = True
        self.wake()

    def wake(self) -> None:
        """Check soon whether there is anything new to draw."""
        self._wake.set()

    def acknowledge(self, client: str, number: int) -> None:
        """Record an acknowledgement; a client without a picture (0) gets one."""
        self._acks.acknowledge(client, number, monotonic_ns())
        self._render_requested |= number == 0
        self.wake()

    def reset(self) -> None:
        """Draw for a page that has connected."""
        self.schedule_render()

    async def close(self) -> None:
        """Nothing to release: `run` is cancelled."""

    async def run(self) -> None:
        """Draw until cancelled."""
        is_high_quality, changed_ns = False, 0
        while True:
            began_ns, pause_ns = monotonic_ns(), self.frame_rate.period_ns
            self._wake.clear()
            changed = self._source.prepare() or self._render_requested
            if changed:
                is_high_quality, changed_ns, self._render_requested = False, began_ns, False
                await _values_sent()
                self._draw(high_quality=False)
                self.frame_rate.record(monotonic_ns() - began_ns)
                pause_ns = self.frame_rate.period_ns
            elif not is_high_quality and began_ns - changed_ns > _STILL_NS:
                is_high_quality = True
                self._draw(high_quality=True)
            else:  # the next step is drawn when it comes; the state of a replay changes by itself
                await _within(self._wake.wait(), pause_ns)
                pause_ns = 0
            await self._rest(began_ns + pause_ns)

    def _picture(self, *, high_quality: bool) -> tuple[bytes, dict[str, object]]:
        """Draw; return the encoded picture and its description."""
        self.rca.set_high_quality(high_quality)
        pixels, columns, rows = self.rca.img_cols_rows
        quality = _HIGH_JPEG_QUALITY if high_quality else _JPEG_QUALITY
        jpeg, meta, _ = RcaImageEncoder.JPEG.encode(pixels, columns, rows, quality)
        return jpeg, meta

    def _draw(self, *, high_quality: bool) -> None:
        content, meta = self._picture(high_quality=high_quality)
        self._number += 1
        self._acks.sent(self._number, monotonic_ns())
        self._source.sent(self._number)
        if self._push is not None:
            self._push(content, {**meta, "number": self._number})

    async def _rest(self, until_ns: int) -> None:
        """Wait until ``until_ns``, and until an active client is ready for another picture."""
        while True:
            now_ns = monotonic_ns()
            if now_ns - self._heartbeat_ns >= _HEARTBEAT_NS:
                self._heartbeat_ns = now_ns
                self._heartbeat(self._number)
            left_ns = until_ns - now_ns
            if left_ns > 0:
                await asyncio.sleep(min(left_ns, _HEARTBEAT_NS) / NS_PER_S)
            elif self._acks.is_pending(now_ns) or not self._acks.any_active(now_ns):
                self._wake.clear()
                await _within(self._wake.wait(), _HEARTBEAT_NS)
            else:
                return


class ClientLoop(RenderLoop):
    """Sends no pictures: the page draws the values that are sent with each number by itself."""

    def _picture(self, *, high_quality: bool) -> tuple[bytes, dict[str, object]]:
        return b"", {"type": ""}


async def _values_sent() -> None:
    """Let the sockets send what `Source.prepare` has published, before drawing blocks them."""
    for _ in range(3):  # wake the task of a page, let it write, let others write
        await asyncio.sleep(0)


async def _within(event: Coroutine[None, None, object], time_ns: int) -> None:
    with suppress(TimeoutError):
        await asyncio.wait_for(event, time_ns / NS_PER_S)
