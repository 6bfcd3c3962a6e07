"""The picture's area and its render loop: pictures as often as drawing and the clients allow."""

import asyncio
from collections.abc import Callable, Coroutine
from contextlib import suppress
from time import monotonic_ns
from typing import Any, Protocol

import numpy as np
from trame_rca.encoders import RcaImageEncoder
from trame_rca.rca import VtkRemoteControlledArea
from trame_slicer.views import ThreeDView

from app.geometry import NS_PER_MS, NS_PER_S
from app.scene.pictures.offscreen_view import png, state_strip
from app.session import ShownState

DEFAULT_SIZE = (1280, 800)
"""Size of a picture before a page has sent one."""
_MIN_SIDE, _MAX_SIDE = 16, 4096
_POINTER_EVENTS = ("Button", "Wheel", "MouseMove", "Pinch", "Pan", "Rotate", "Tap")


class PictureArea(VtkRemoteControlledArea):  # type: ignore[misc]  # trame has no types
    """Renders a view, and lets the pointer on the page move its camera.

    Key events are ignored: VTK switches to wireframe at some keys, and ends its loop at others.
    """

    def __init__(self, view: ThreeDView) -> None:
        super().__init__(view.render_window())
        self._view = view
        self._grabbed = False
        self._size: tuple[int, int] | None = DEFAULT_SIZE

    def process_interaction_event(self, event: dict[str, Any]) -> None:
        """Process an event of a mouse or a touch screen."""
        kind = str(event["type"])
        if any(name in kind for name in _POINTER_EVENTS):
            self._grabbed |= "Press" in kind or "Start" in kind
            super().process_interaction_event(event)

    def process_resize_event(self, width: int, height: int) -> None:
        """Use the size of the area on the page, in pixels, from the next picture on."""
        self._size = _within_limits(width), _within_limits(height)

    def take_grabbed(self) -> bool:
        """Return True if the pointer has grabbed the view since the last call."""
        grabbed, self._grabbed = self._grabbed, False
        return grabbed

    def take_resized(self) -> bool:
        """Apply a new size; return True if there was one since the last call."""
        size, self._size = self._size, None
        if size is not None:
            super().process_resize_event(*size)
        return size is not None

    def set_high_quality(self, high_quality: bool) -> None:
        """Smooth edges and sort translucent surfaces, which takes three times as long."""
        renderer = self._view.renderer()
        renderer.SetUseFXAA(high_quality)
        renderer.SetUseDepthPeeling(high_quality)


def _within_limits(side: int) -> int:
    return min(max(side, _MIN_SIDE), _MAX_SIDE)


_TIMEOUT_NS = NS_PER_S
"""A client that is silent, or has not received a picture, for so long is not waited for."""


class ClientAcks:
    """Tracks which client has which picture. Times are those of one steady clock, in ns.

    A client acknowledges its last picture with each picture and with each heartbeat. It sends 0
    before its first picture, when no picture is on the way to it.
    """

    def __init__(self) -> None:
        self._last_sent = 0
        self._sent_ns = 0
        self._acks: dict[str, tuple[int, int]] = {}
        """Per client: its last picture, and the time of the acknowledgement."""

    def sent(self, number: int, now_ns: int) -> None:
        """Record that picture ``number`` was sent to all clients."""
        self._last_sent, self._sent_ns = number, now_ns

    def acknowledge(self, client: str, number: int, now_ns: int) -> None:
        """Record that picture ``number`` is the last one that ``client`` has; 0 for none."""
        self._acks[client] = (number or self._last_sent, now_ns)

    def any_active(self, now_ns: int) -> bool:
        """True if a client has sent an acknowledgement within the timeout."""
        self._acks = {
            client: (number, at_ns)
            for client, (number, at_ns) in self._acks.items()
            if now_ns - at_ns <= _TIMEOUT_NS
        }
        return bool(self._acks)

    def is_pending(self, now_ns: int) -> bool:
        """True while no active client has acknowledged the last picture; one of them is enough."""
        if not self.any_active(now_ns) or now_ns - self._sent_ns > _TIMEOUT_NS:
            return False
        return all(number < self._last_sent for number, _ in self._acks.values())


MAX_LOAD = 0.85
"""Share of the time that drawing may take; above it a backlog builds up."""
LOAD_BESIDE_CONTROLLER = 0.3
"""The same on a machine that also controls an arm."""
_MAX_HZ, _MIN_HZ = 30.0, 2.0
_SMOOTHING = 0.8
"""Weight of the last estimate after a cheaper picture; a costlier one counts at once."""


class FrameRate:
    """Computes the period of pictures from their cost: drawing takes at most ``max_load``."""

    def __init__(self, max_load: float = MAX_LOAD) -> None:
        self._max_load = max_load
        self._cost_ns = 0.0

    def record(self, cost_ns: int) -> None:
        """Take the time in ns for which the last picture has occupied the thread."""
        smoothed_ns = _SMOOTHING * self._cost_ns + (1.0 - _SMOOTHING) * cost_ns
        self._cost_ns = max(float(cost_ns), smoothed_ns)

    @property
    def period_ns(self) -> int:
        """Time in ns from the start of one picture to the start of the next."""
        period_ns = self._cost_ns / self._max_load
        return round(min(max(period_ns, NS_PER_S / _MAX_HZ), NS_PER_S / _MIN_HZ))


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


_BANNER_PIXELS = 44


def screenshot(area: PictureArea, state: ShownState, text: str) -> bytes:
    """Draw the view in high quality, in its size on the page, below a banner with ``text``.

    The banner has the colour and the symbol of ``state``, because the file is viewed without the
    page.
    """
    area.set_high_quality(True)
    pixels, width, _ = area.img_cols_rows
    return png(np.concatenate([state_strip(text, (width, _BANNER_PIXELS), state), pixels]))
