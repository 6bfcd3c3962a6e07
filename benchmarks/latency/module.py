"""The module ROS2 of desktop Slicer as a receiver: its own logic, nodes and spinner."""

import sys
import time
from collections.abc import Sequence
from typing import Any

from slicer import vtkMRMLScene

from app.files.shipped import shipped
from app.scene import SceneApplication, offscreen_view
from benchmarks.latency.bodies import ROOT
from benchmarks.latency.qt_receiver import QtReceiver, Waking
from benchmarks.latency.receivers import add_bodies, complete_frame_stamp

FOLDER = shipped("slicer_module", "ROS2")
PICTURE = (640, 480)


class ModuleReceiver(QtReceiver):
    """The module's logic in a scene of its own, with a ROS node."""

    def __init__(self, waking: Waking) -> None:
        super().__init__(waking)
        if str(FOLDER) not in sys.path:
            sys.path.insert(0, str(FOLDER))  # as Slicer does
        from ROS2Lib.logic import Ros2Api

        self.application = SceneApplication(vtkMRMLScene())
        self.arrivals_ns = []
        self._arrivals_ns = self.arrivals_ns
        self.logic = Ros2Api(self.application.scene, self._received)
        self.node = self.logic.GetDefaultROS2Node()
        self.logic.Spin()

    def close(self) -> None:
        """Leave the graph."""
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
        self._close_view: Any = None
        if draws:
            self._close_view = offscreen_view(self.application, "latency", PICTURE)
            self._view = self._close_view.__enter__()

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
        """Leave the graph, and close the view."""
        if self._close_view is not None:
            self._close_view.__exit__(None, None, None)
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
