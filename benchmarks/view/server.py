"""Serves a replay whose pictures carry the number of their frame.

    python -m benchmarks.view.server ours|default CASE

Prints the page's address. On a line on standard input it plays from the first frame and prints
``due``, the due times of all frames on the machine's clock in ms. Ends with standard input.
"""

import asyncio
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from trame_rca.schedulers import RcaImageRenderScheduler
from trame_slicer.views import ThreeDView

from app.cli.process import SignalState
from app.cli.replay_page import replay_parts
from app.viewer import Address, SceneView, Title, Viewer
from app.viewer.drawing.render_loop import PictureArea, RenderLoop, Source
from app.viewer.feeds import ReplayControl
from benchmarks.harness.peer import emit
from benchmarks.view.stamps import stamp

POSES_HZ = 100.0  # rate of scene updates of the default schedule, above that of the tracker's poses


class StampedArea(PictureArea):
    """Draws the number of the shown frame into each picture."""

    def __init__(self, view: ThreeDView, shown: "ShownFrame") -> None:
        super().__init__(view)
        self._shown = shown

    @property
    def img_cols_rows(self) -> tuple[Any, int, int]:
        pixels, columns, rows = super().img_cols_rows
        stamp(pixels, self._shown.index)
        return pixels, columns, rows


class ShownFrame:
    """A feed that remembers the last returned frame, which the next picture shows."""

    def __init__(self, feed: Any) -> None:
        self._feed = feed
        self.index = 0

    def now(self) -> Any:
        shown = self._feed.now()
        self.index = shown.step.index
        return shown


class DefaultSchedule(RcaImageRenderScheduler):
    """A picture after each new pose, trame-slicer's default as `register_rca_factories` creates it.

    It aims at 30 pictures a second, whatever rendering costs, and sends without acknowledgement.
    """

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
            await asyncio.sleep(1.0 / POSES_HZ)


SCHEDULES = {"ours": RenderLoop, "default": DefaultSchedule}


def main() -> None:
    schedule, case = sys.argv[1:]
    parts = replay_parts(Path(case), (), SignalState(), tip_only=False)
    shown = ShownFrame(parts.feed)
    viewer = Viewer(
        SceneView(parts.content),
        shown,
        parts.timeline,
        Title(parts.content.name, live=False),
        parts.feed.control,
        area=lambda view: StampedArea(view, shown),
        scheduler=SCHEDULES[schedule],
    )

    address = Address("127.0.0.1", 0, "benchmark")

    def ready(port: int) -> None:
        print(address.url(port), flush=True)
        threading.Thread(
            target=play_on_command, args=(parts.feed.control, viewer), daemon=True
        ).start()

    asyncio.run(viewer.serve(address, ready))


def play_on_command(control: ReplayControl, viewer: Viewer) -> None:
    """Play on each line of standard input, stop at its end."""
    for _ in sys.stdin:
        began_ms = time.time_ns() / 1e6
        control.play()
        emit("due", ms=[began_ms + control.time_ns(n) / 1e6 for n in range(control.frames)])
    viewer.stop()


if __name__ == "__main__":
    main()
