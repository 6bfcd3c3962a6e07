"""Draws pictures and sends them: as often as drawing allows, and none that nobody has time for."""

import asyncio
from collections.abc import Callable, Coroutine
from contextlib import suppress
from time import monotonic_ns
from typing import Protocol

from trame_rca.encoders import RcaImageEncoder

from app.geometry import NS_PER_MS, NS_PER_S
from app.viewer.drawing.area import PictureArea
from app.viewer.drawing.client_acks import Pages
from app.viewer.drawing.frame_rate import Pace

_QUALITY, _FINE_QUALITY = 75, 92
_BEAT_NS = 200 * NS_PER_MS
_STILL_NS = 400 * NS_PER_MS
"""A picture that did not change for so long is drawn once more, finely."""

Push = Callable[[bytes, dict[str, object]], None]


class Source(Protocol):
    """What there is to draw."""

    def prepare(self) -> bool:
        """Bring the scene to the present; whether that changed anything."""

    def sent(self, number: int) -> None:
        """Picture ``number`` of the scene as it was prepared is on its way."""


class Schedule(Protocol):
    """Decides when an area is drawn, and draws it."""

    def schedule_render(self) -> None:
        """Draw, although nothing may have changed in the steps: a camera, a size, a colour."""

    def look(self) -> None:
        """There may be something new to draw."""

    def has(self, page: str, number: int) -> None:
        """``page`` says that picture ``number`` is its last; a new page has none: 0."""

    async def run(self) -> None:
        """Draw until cancelled."""


MakeSchedule = Callable[[PictureArea, Source, Callable[[int], None]], Schedule]
"""Of an area, of what there is to draw, and of what is to be called with each heartbeat."""


class Pictures:
    """The page's `Schedule`, as trame wants it (`RcaRenderSchedulerProtocol`).

    One picture is in flight at a time: the next is drawn when every page that is awake has the
    last, and then shows the newest state. ``beat`` is called with the last picture's number by
    the loop itself, so that a heartbeat says that pictures are still being made.
    """

    def __init__(self, area: PictureArea, source: Source, beat: Callable[[int], None]) -> None:
        self.rca = area
        self.pace = Pace()
        self._pages = Pages()
        self._number = 0
        self._source = source
        self._beat = beat
        self._beaten_ns = 0
        self._push: Push | None = None
        self._asked = True
        self._wake = asyncio.Event()

    @property
    def target_fps(self) -> float:
        """What the pace allows now."""
        return NS_PER_S / self.pace.period_ns

    @target_fps.setter
    def target_fps(self, value: float) -> None:
        """The pace is measured: a wish is not taken."""

    def set_push_callback(self, callback: Push) -> None:
        """Where pictures go."""
        self._push = callback

    def schedule_render(self) -> None:
        """Draw, although nothing may have changed in the steps: a camera, a size, a colour."""
        self._asked = True
        self.look()

    def look(self) -> None:
        """There may be something new to draw."""
        self._wake.set()

    def has(self, page: str, number: int) -> None:
        """Take a receipt; a page without a picture is given one."""
        self._pages.has(page, number, monotonic_ns())
        self._asked |= number == 0
        self.look()

    def reset(self) -> None:
        """A page has come: it needs a picture."""
        self.schedule_render()

    async def close(self) -> None:
        """Nothing is left behind when `run` is cancelled."""

    async def run(self) -> None:
        """Draw until cancelled."""
        fine, changed_ns = False, 0
        while True:
            began_ns = monotonic_ns()
            changed = self._source.prepare() or self._asked
            if changed:
                fine, changed_ns, self._asked = False, began_ns, False
                self._draw(fine=False)
                self.pace.drew(monotonic_ns() - began_ns)
            elif not fine and began_ns - changed_ns > _STILL_NS:
                fine = True
                self._draw(fine=True)
            await self._rest(began_ns + self.pace.period_ns)

    def _draw(self, *, fine: bool) -> None:
        self.rca.set_fine(fine)
        pixels, columns, rows = self.rca.img_cols_rows
        quality = _FINE_QUALITY if fine else _QUALITY
        jpeg, meta, _ = RcaImageEncoder.JPEG.encode(pixels, columns, rows, quality)
        self._number += 1
        self._pages.sent(self._number, monotonic_ns())
        self._source.sent(self._number)
        if self._push is not None:
            self._push(jpeg, {**meta, "number": self._number})

    async def _rest(self, until_ns: int) -> None:
        """Until the pace allows another picture, and somebody has time for it."""
        while True:
            now_ns = monotonic_ns()
            if now_ns - self._beaten_ns >= _BEAT_NS:
                self._beaten_ns = now_ns
                self._beat(self._number)
            left_ns = until_ns - now_ns
            if left_ns > 0:
                await asyncio.sleep(min(left_ns, _BEAT_NS) / NS_PER_S)
            elif self._pages.waiting(now_ns) or not self._pages.any_awake(now_ns):
                self._wake.clear()
                await _within(self._wake.wait(), _BEAT_NS)
            else:
                return


async def _within(event: Coroutine[None, None, object], time_ns: int) -> None:
    with suppress(TimeoutError):
        await asyncio.wait_for(event, time_ns / NS_PER_S)
