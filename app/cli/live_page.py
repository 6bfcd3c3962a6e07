"""The page of a live session, which runs in a thread of its own beside it."""

import argparse
import sys
import threading
import time
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

from app.cli.publishing import bridge_loaded
from app.cli.signals import SignalState

if TYPE_CHECKING:
    from app.bridge import ReplayScene
    from app.bridge.live import LiveNode
    from app.geometry import SurfaceMesh
    from app.runtime import SessionContent
    from app.viewer import LiveFeed, Viewer

CONSTRAINT_HZ = 100.0
"""How often the constraint is repeated: beside a page that draws there is no room for 1 kHz."""


@contextmanager
def live_page(options: argparse.Namespace, received: SignalState) -> Iterator["Viewer"]:
    """A page for the session of ``options.config``, which runs within the context.

    Up to then a signal ends the process at once.
    """
    with received.ends_at_once():
        from app.bridge.latest_value import SWITCH_INTERVAL_S
        from app.bridge.live import guarding
        from app.case import open_live
        from app.runtime import content_of
        from app.session import setup_from_case, with_repaired_tumor
        from app.viewer import (
            LiveFeed,
            LiveTimeline,
            SceneView,
            Title,
            Viewer,
            Watcher,
            stop_surface,
        )

        bridge_loaded("a live session is ROS")
        config = open_live(options.config, package_dirs=options.package_dirs)
        case = with_repaired_tumor(config.case)
        for note in case.notes():
            print(note, file=sys.stderr)
        tip_only: bool = options.tip_only
        setup = setup_from_case(case, tip_only=tip_only)
        content = content_of(case, setup, tip_only=tip_only)
        margin_surface = stop_surface(content)
        watcher = Watcher(setup, content, margin_surface)
        feed = LiveFeed(watcher, setup.margins.stale_after_ns, time.monotonic_ns)
        title = Title(case.manifest.name, live=True)
        viewer = Viewer(SceneView(content), feed, LiveTimeline(), title)
        feed.wakes(viewer.look)
        sys.setswitchinterval(SWITCH_INTERVAL_S)
    with guarding(
        config,
        case,
        setup,
        namespace=options.namespace,
        constraint_hz=CONSTRAINT_HZ,
        tip_only=tip_only,
    ) as guard:
        follow = partial(_follow, guard, feed, content, margin_surface)
        thread = threading.Thread(target=follow, name="session")
        thread.start()
        try:
            yield viewer
        finally:
            guard.live.stop()
            thread.join()


def _follow(
    guard: "LiveNode",
    feed: "LiveFeed",
    content: "SessionContent",
    margin_surface: "SurfaceMesh | None",
) -> None:
    """Put every step into the feed; if the session fails, the page says so and stays grey."""
    why = "the session has ended"
    with ThreadPoolExecutor(max_workers=1) as makers:
        contents = LiveContent(content, margin_surface, guard.changes.scene, makers)
        try:
            for step in guard.steps():
                feed.put(step, *contents.of(guard.changes.scene))
        except Exception as error:
            why = f"the session has failed: {error}"
            raise
        finally:
            feed.end(why)


class LiveContent:
    """The content of a session that may be given another tumour, margin or registration.

    The margin surface takes a second to compute: it is None until then, never that of before.
    """

    def __init__(
        self,
        content: "SessionContent",
        margin_surface: "SurfaceMesh | None",
        scene: "ReplayScene",
        makers: ThreadPoolExecutor,
    ) -> None:
        self._content = content
        self._margin_surface = margin_surface
        self._scene = scene
        self._makers = makers
        self._making: Future[SurfaceMesh | None] | None = None

    def of(self, scene: "ReplayScene") -> "tuple[SessionContent, SurfaceMesh | None]":
        """The content and the margin surface of a step that was taken with ``scene``."""
        from app.viewer import stop_surface

        if scene is not self._scene:
            self._scene = scene
            self._content = _changed(self._content, scene)
            self._margin_surface = None
            self._making = self._makers.submit(stop_surface, self._content)
        if self._making is not None and self._making.done():
            self._margin_surface = _made(self._making)
            self._making = None
        return self._content, self._margin_surface


def _changed(content: "SessionContent", scene: "ReplayScene") -> "SessionContent":
    robot = content.robot
    # The edge from the base to the robot's root link is not part of the content.
    roots = set() if robot is None else {robot.robot.root_link} - {robot.base_frame}
    return replace(
        content,
        tumor=scene.tumor,
        margins=scene.margins,
        static_edges=tuple(edge for edge in scene.static_edges if edge.source not in roots),
        robot=None if robot is None else replace(robot, registration=scene.registration),
    )


def _made(making: "Future[SurfaceMesh | None]") -> "SurfaceMesh | None":
    """What was made; the guard does not end for want of a surface that is only looked at."""
    from app.geometry import MarginGuardError

    try:
        return making.result()
    except MarginGuardError as error:
        print(f"no margin surface is shown: {error}", file=sys.stderr)
        return None
