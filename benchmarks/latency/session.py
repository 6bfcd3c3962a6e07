"""A live session as a receiver: in the panel of desktop Slicer, and in the page."""

import argparse
import asyncio
import sys
import threading
import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from slicer import vtkMRMLScene

from app.cli.live_page import live_page
from app.cli.signals import SignalState
from app.files.shipped import shipped
from app.scene import SceneApplication
from app.session import StepResult
from app.viewer import Address
from app.viewer.drawing.area import PictureArea
from app.viewer.drawing.pictures import RenderLoop, Source
from benchmarks.latency.qt_receiver import QtReceiver, Waking
from benchmarks.latency.receivers import Receiver

FOLDER = shipped("slicer_module", "MarginGuard")
CONFIG = shipped("data", "live_example", "live.yaml")
_POLL_S = 0.1


def complete_stamp(step: StepResult) -> int | None:
    """Stamp of the step's frame; None while a sample of it is missing."""
    stamps_ns = {sample.stamp.ns for sample in step.frame.poses}
    return stamps_ns.pop() if len(stamps_ns) == 1 else None


class PanelReceiver(QtReceiver):
    """The panel's logic: session, ROS node and display in a scene of its own."""

    def __init__(self, waking: Waking) -> None:
        super().__init__(waking)
        if str(FOLDER) not in sys.path:
            sys.path.insert(0, str(FOLDER))  # as Slicer does
        from MarginGuardLib.logic import PanelLogic

        application = SceneApplication(vtkMRMLScene())
        # Steps are ready on the clock of the stamps.
        self.panel = PanelLogic(
            application.scene, application.logic, clock_ns=time.time_ns, changed=self.wake
        )
        self.panel.connect(Path(CONFIG))

    def spin(self) -> None:
        """Spin the panel's logic."""
        self.panel.spin()
        now_ns = time.time_ns()
        step, ready_ns = self.panel.session.shown_step, self.panel.session.ready_ns
        if step is None or ready_ns is None:
            return
        count, stamp_ns = len(self.rows), complete_stamp(step)
        self.add_row(stamp_ns, now_ns)
        if stamp_ns is not None and len(self.rows) > count:
            self.steps.append((stamp_ns, ready_ns))

    def close(self) -> None:
        """End the session."""
        super().close()
        self.panel.close()


class PageReceiver(Receiver):
    """`marginguard view --live` without a browser: one client that acknowledges at once.

    ``pictures``: when the picture of a step was encoded and sent.
    """

    def run(self, has_ended: Callable[[], bool]) -> None:
        """Serve the page until ``has_ended()``."""
        options = argparse.Namespace(
            config=Path(CONFIG),
            package_dirs=(),
            tip_only=False,
            namespace="",
            audit=None,
            cases=None,
        )
        with ExitStack() as stack:
            viewer = stack.enter_context(live_page(options, SignalState(), scheduler=self._loop))

            def stop_at_end() -> None:
                while not has_ended():
                    time.sleep(_POLL_S)
                viewer.stop()

            stopper = threading.Thread(target=stop_at_end)
            address = Address("127.0.0.1", 0, "benchmark")
            asyncio.run(viewer.serve(address, lambda _: stopper.start()))
            stopper.join()

    def close(self) -> None:
        """The page is closed already."""

    def _loop(
        self, area: PictureArea, source: Source, heartbeat: Callable[[int], None]
    ) -> RenderLoop:
        timed = TimedSource(source, self)
        loop = timed.loop = RenderLoop(area, timed, heartbeat)
        loop.acknowledge("benchmark", 0)
        return loop


class TimedSource:
    """What the page draws, with the times at which it was in the scene and sent."""

    def __init__(self, source: Any, receiver: PageReceiver) -> None:
        self.loop: RenderLoop | None = None
        self._source = source
        self._receiver = receiver

    def prepare(self) -> bool:
        """Update the scene."""
        changed: bool = self._source.prepare()
        now_ns, shown = time.time_ns(), self._source.shown
        if changed and shown is not None:
            self._receiver.add_row(complete_stamp(shown.step), now_ns)
        return changed

    def sent(self, number: int) -> None:
        """Note the picture, and acknowledge it."""
        now_ns, shown = time.time_ns(), self._source.shown
        stamp_ns = None if shown is None else complete_stamp(shown.step)
        pictures = self._receiver.pictures
        if stamp_ns is not None and (not pictures or pictures[-1][0] != stamp_ns):
            pictures.append((stamp_ns, now_ns))
        self._source.sent(number)
        if self.loop is not None:
            asyncio.get_running_loop().call_soon(self.loop.acknowledge, "benchmark", number)
