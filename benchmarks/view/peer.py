"""trame-slicer's default schedule behind the same page and the same view.

It is `trame_rca.schedulers.RcaImageRenderScheduler` as `register_rca_factories` creates it: it
aims at 30 pictures a second, whatever rendering costs, and sends without acknowledgement.
"""

import asyncio
from collections.abc import Callable
from typing import Any

from trame_rca.schedulers import RcaImageRenderScheduler

from app.viewer.drawing.area import PictureArea
from app.viewer.drawing.pictures import Source

_POSES_HZ = 100.0
"""Rate of scene updates, above the rate of the tracker's poses."""


class DefaultSchedule(RcaImageRenderScheduler):
    """Schedules a picture after every new pose, as a scene's events would."""

    def __init__(self, area: PictureArea, source: Source, beat: Callable[[int], None]) -> None:
        super().__init__(area, target_fps=30.0, interactive_quality=50, rca_encoder="jpeg")
        self._source = source
        self._beat = beat
        self._number = 0

    def set_push_callback(self, callback: Callable[[bytes, dict[str, Any]], None]) -> None:
        """Add a number to each picture, which the page expects."""

        def push(content: bytes, meta: dict[str, Any]) -> None:
            self._number += 1
            self._source.sent(self._number)
            callback(content, {**meta, "number": self._number})

        super().set_push_callback(push)

    def wake(self) -> None:
        """Do nothing: `run` schedules the pictures."""

    def acknowledge(self, client: str, number: int) -> None:
        """Render for a page that has just connected; acknowledgements are ignored."""
        if number == 0:
            self.schedule_render()

    async def run(self) -> None:
        """Update the scene for ever and schedule a picture whenever it has changed."""
        while True:
            if self._source.prepare():
                self.schedule_render()
            self._beat(self._number)
            await asyncio.sleep(1.0 / _POSES_HZ)
