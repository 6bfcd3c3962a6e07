"""The schedule that trame-slicer has by default, behind the same page and the same view.

Its own: `trame_rca.schedulers.RcaImageRenderScheduler` as `register_rca_factories` makes it, 30
pictures a second wanted, whatever drawing costs; pictures are sent without asking who has them.
"""

import asyncio
from collections.abc import Callable
from typing import Any

from trame_rca.schedulers import RcaImageRenderScheduler

from app.viewer.drawing.area import PictureArea
from app.viewer.drawing.pictures import Source

_POSES_HZ = 100.0
"""How often the scene is brought to the present: more often than the tracker's poses come."""


class DefaultSchedule(RcaImageRenderScheduler):
    """Told of every new pose, as a scene's events would."""

    def __init__(self, area: PictureArea, source: Source, beat: Callable[[int], None]) -> None:
        super().__init__(area, target_fps=30.0, interactive_quality=50, rca_encoder="jpeg")
        self._source = source
        self._beat = beat
        self._number = 0

    def set_push_callback(self, callback: Callable[[bytes, dict[str, Any]], None]) -> None:
        """Number the pictures, as the page wants them."""

        def push(content: bytes, meta: dict[str, Any]) -> None:
            self._number += 1
            self._source.sent(self._number)
            callback(content, {**meta, "number": self._number})

        super().set_push_callback(push)

    def wake(self) -> None:
        """It is told by `run`."""

    def acknowledge(self, client: str, number: int) -> None:
        """Draw for a page that has just come; receipts are not waited for."""
        if number == 0:
            self.schedule_render()

    async def run(self) -> None:
        """Bring the scene to the present for ever, and ask for a picture whenever it changed."""
        while True:
            if self._source.prepare():
                self.schedule_render()
            self._beat(self._number)
            await asyncio.sleep(1.0 / _POSES_HZ)
