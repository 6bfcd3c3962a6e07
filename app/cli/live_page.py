"""The page of a live session, which runs in a thread of its own beside it."""

import argparse
import sys
import threading
import time
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import replace
from typing import TYPE_CHECKING

from app.cli.publishing import bridge_loaded
from app.cli.signals import SignalState

if TYPE_CHECKING:
    from app.bridge import ReplayScene
    from app.bridge.live import LiveNode
    from app.geometry import SurfaceMesh
    from app.viewer import Cast, LiveFeed, Viewer

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
        from app.session import setup_from_case, with_repaired_tumor
        from app.viewer import Cast, LiveFeed, LiveTimeline, SceneView, Title, Viewer, Watcher

        bridge_loaded("a live session is ROS")
        config = open_live(options.config, package_dirs=options.package_dirs)
        case = with_repaired_tumor(config.case)
        for note in case.notes():
            print(note, file=sys.stderr)
        tip_only: bool = options.tip_only
        setup = setup_from_case(case, tip_only=tip_only)
        cast = Cast.of(setup, case.tumor_mesh(), None if tip_only else case.tool_mesh())
        feed = LiveFeed(Watcher(setup, cast), setup.margins.stale_after_ns, time.monotonic_ns)
        title = Title(case.manifest.name, live=True)
        viewer = Viewer(SceneView(cast), feed, LiveTimeline(), title)
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
        thread = threading.Thread(target=_follow, args=(guard, feed, cast), name="session")
        thread.start()
        try:
            yield viewer
        finally:
            guard.live.stop()
            thread.join()


def _follow(guard: "LiveNode", feed: "LiveFeed", cast: "Cast") -> None:
    """Hand every step to the feed; where the session fails, the page says so and stays grey."""
    why = "the session has ended"
    with ThreadPoolExecutor(max_workers=1) as makers:
        casting = Casting(cast, guard.changes.scene, makers)
        try:
            for step in guard.steps():
                feed.put(step, casting.of(guard.changes.scene))
        except Exception as error:
            why = f"the session has failed: {error}"
            raise
        finally:
            feed.end(why)


class Casting:
    """The cast of a session that may be given another tumour, margin or registration.

    The surface at the margin takes a second to make: until then there is none, and not an old one.
    """

    def __init__(self, cast: "Cast", scene: "ReplayScene", makers: ThreadPoolExecutor) -> None:
        self._cast = cast
        self._scene = scene
        self._makers = makers
        self._making: Future[SurfaceMesh | None] | None = None

    def of(self, scene: "ReplayScene") -> "Cast":
        """That of a step which was taken with ``scene``."""
        from app.viewer import stop_surface

        if scene is not self._scene:
            self._scene = scene
            self._cast = replace(
                self._cast,
                tumor=scene.tumor,
                fixed=scene.static_edges,
                registration=scene.registration,
                margin=None,
            )
            self._making = self._makers.submit(stop_surface, scene.tumor, scene.margins.stop_mm)
        if self._making is not None and self._making.done():
            self._cast = replace(self._cast, margin=_made(self._making))
            self._making = None
        return self._cast


def _made(making: "Future[SurfaceMesh | None]") -> "SurfaceMesh | None":
    """What was made; the guard does not end for want of a surface that is only looked at."""
    from app.geometry import MarginGuardError

    try:
        return making.result()
    except MarginGuardError as error:
        print(f"no margin surface is shown: {error}", file=sys.stderr)
        return None
