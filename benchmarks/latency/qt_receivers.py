"""Receivers in Qt's event loop, woken by messages or by a timer as before, and the live page.

The module ROS2 of desktop Slicer with its own logic, nodes and spinner; a live session in the panel
MarginGuard; and a live session in the page.
"""

import argparse
import asyncio
import os
import sys
import threading
import time
from abc import abstractmethod
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")

from PySide6 import QtCore, QtWidgets
from slicer import vtkMRMLScene

from app.cli.commands import view
from app.cli.live_page import live_page
from app.cli.process import SignalState
from app.files.paths import shipped
from app.runtime import QtSpinner
from app.scene import SceneApplication, offscreen_view
from app.session import StepResult
from app.viewer import Address
from app.viewer.drawing.render_loop import PictureArea, RenderLoop, Source
from benchmarks.latency.qt_loops import LOOPS, quit_loop
from benchmarks.latency.receivers import Receiver, Waking, add_bodies, complete_frame_stamp
from benchmarks.latency.senders import ROOT

CONFIG = Path(shipped("data", "live_example", "live.yaml"))
PICTURE = (640, 480)
_POLL_MS = 100
_LONGEST_MS = 3_600_000


class QtReceiver(Receiver):
    """Calls `spin` in Qt's event loop; ``wake`` may be called in any thread."""

    def __init__(self, waking: Waking) -> None:
        super().__init__()
        # A process has one application, and a module's widgets need this class.
        self._application = QtWidgets.QApplication.instance() or QtWidgets.QApplication([])
        self._run_loop, keeps_lock = LOOPS[waking.loop]
        self._driver: Any
        if waking.timer_ms is None:
            self._driver = QtSpinner(QtCore, self.spin, keeps_lock=keeps_lock)
            self.wake: Callable[[], None] = self._driver.wake
        else:
            self._driver = QtCore.QTimer()
            self._driver.timeout.connect(self.spin)
            self._driver.start(waking.timer_ms)
            self.wake = lambda: None

    @abstractmethod
    def spin(self) -> None:
        """Update the scene."""

    def run(self, has_ended: Callable[[], bool]) -> None:
        poll = QtCore.QTimer()
        poll.timeout.connect(lambda: quit_loop() if has_ended() else None)
        poll.start(_POLL_MS)
        self._run_loop(_LONGEST_MS)
        poll.stop()

    def close(self) -> None:
        self._driver.stop()


def _add_to_path(module: str) -> None:
    """Make the library of a scripted module importable, as Slicer does."""
    folder = str(shipped("slicer_module", module))
    if folder not in sys.path:
        sys.path.insert(0, folder)


class ModuleReceiver(QtReceiver):
    """The module's logic in a scene of its own, with a ROS node."""

    def __init__(self, waking: Waking) -> None:
        super().__init__(waking)
        _add_to_path("ROS2")
        from ROS2Lib.logic import Ros2Api

        self.application = SceneApplication(vtkMRMLScene())
        self.arrivals_ns = []
        self._arrivals_ns = self.arrivals_ns
        self.logic = Ros2Api(self.application.scene, self._received)
        self.node = self.logic.GetDefaultROS2Node()
        self.logic.Spin()

    def close(self) -> None:
        super().close()
        self.logic.Destroy()

    def _received(self) -> None:
        self._arrivals_ns.append(time.time_ns())
        self.wake()


class BodiesInModule(ModuleReceiver):
    """One lookup for each body, with a model below it."""

    def __init__(self, frames: Sequence[str], waking: Waking) -> None:
        super().__init__(waking)
        self.lookups = [self.node.CreateAndAddTf2LookupNode(ROOT, frame) for frame in frames]
        add_bodies(self.application.scene, frames, self.lookups)

    def spin(self) -> None:
        """Spin the module; a frame is complete when all of its bodies are."""
        self.logic.Spin()
        now_ns = time.time_ns()
        stamps_ns = [each.GetStampNanoseconds() or 0 for each in self.lookups]
        self.add_row(complete_frame_stamp(stamps_ns) or None, now_ns)


class RobotsInModule(ModuleReceiver):
    """Robots described by parameters of their senders; with ``draws`` the scene is drawn, too."""

    def __init__(self, names: Sequence[str], waking: Waking, *, draws: bool = False) -> None:
        super().__init__(waking)
        self.robots = [
            self.logic.AddRobot(name, f"/{name}", "robot_description", "world", name)
            for name in names
        ]
        self.rows_of: dict[str, list[tuple[int, int]]] = {name: [] for name in names}
        self._moving: dict[str, Any] = {}
        self._view: Any = None
        self._stack = ExitStack()
        if draws:
            view = offscreen_view(self.application, "latency", PICTURE)
            self._view = self._stack.enter_context(view)

    def spin(self) -> None:
        """Spin the module; note the newest frame of each robot."""
        self.logic.Spin()
        now_ns = time.time_ns()
        is_new = False
        for name, rows in self.rows_of.items():
            stamp_ns = self._stamp_ns(name)
            if stamp_ns is not None and (not rows or rows[-1][0] != stamp_ns):
                rows.append((stamp_ns, now_ns))
                is_new = True
        if is_new and self._view is not None:
            self._view.pixels()
            self.pictures.append((next(iter(self.rows_of.values()))[-1][0], time.time_ns()))

    def close(self) -> None:
        self._stack.close()
        super().close()

    def _stamp_ns(self, name: str) -> int | None:
        """Stamp of the robot's last link, which every message has; None before the first."""
        if name not in self._moving:
            robot = self.node.GetRobotNodeByName(name)
            links = robot.GetLinkNames()
            if not links:
                return None
            self._moving[name] = self.application.scene.GetNodeByID(
                robot.GetNthNodeReferenceID("lookup", len(links) - 1)
            )
        return self._moving[name].GetStampNanoseconds()


def complete_stamp(step: StepResult) -> int | None:
    """Stamp of the step's frame; None while a sample of it is missing."""
    stamps_ns = {sample.stamp.ns for sample in step.frame.poses}
    return stamps_ns.pop() if len(stamps_ns) == 1 else None


class PanelReceiver(QtReceiver):
    """The panel's logic: session, ROS node and display in a scene of its own."""

    def __init__(self, waking: Waking) -> None:
        super().__init__(waking)
        _add_to_path("MarginGuard")
        from MarginGuardLib.logic import PanelLogic

        application = SceneApplication(vtkMRMLScene())
        # Steps are ready on the clock of the stamps.
        self.panel = PanelLogic(
            application.scene, application.logic, clock_ns=time.time_ns, changed=self.wake
        )
        self.panel.connect(CONFIG)

    def spin(self) -> None:
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
        super().close()
        self.panel.close()


class PageReceiver(Receiver):
    """`marginguard view --live` without a browser: one client that acknowledges at once.

    ``pictures``: when the picture of a step was encoded and sent.
    """

    def run(self, has_ended: Callable[[], bool]) -> None:
        parser = argparse.ArgumentParser()
        view.add_arguments(parser)
        options = parser.parse_args(["--live", "--config", str(CONFIG)])
        with ExitStack() as stack:
            viewer = stack.enter_context(live_page(options, SignalState(), scheduler=self._loop))

            def stop_at_end() -> None:
                while not has_ended():
                    time.sleep(_POLL_MS / 1000.0)
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
    """Source of the page's pictures, with the times at which each was in the scene and sent."""

    def __init__(self, source: Any, receiver: PageReceiver) -> None:
        self.loop: RenderLoop | None = None
        self._source = source
        self._receiver = receiver

    def prepare(self) -> bool:
        changed: bool = self._source.prepare()
        now_ns, shown = time.time_ns(), self._source.shown
        if changed and shown is not None:
            self._receiver.add_row(complete_stamp(shown.step), now_ns)
        return changed

    def sent(self, number: int) -> None:
        now_ns, shown = time.time_ns(), self._source.shown
        stamp_ns = None if shown is None else complete_stamp(shown.step)
        pictures = self._receiver.pictures
        if stamp_ns is not None and (not pictures or pictures[-1][0] != stamp_ns):
            pictures.append((stamp_ns, now_ns))
        self._source.sent(number)
        if self.loop is not None:
            asyncio.get_running_loop().call_soon(self.loop.acknowledge, "benchmark", number)
