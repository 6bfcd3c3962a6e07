"""A live session that other nodes lead through its life cycle: ``marginguard live --lifecycle``."""

import threading
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, closing

from app.bridge.live.live_node import LiveNode
from app.bridge.node import RosNode
from app.session import StepResult


class LiveNodeLifecycle:
    """What `app.bridge.control.LifecycleRosNode` manages: a `LiveNode`, made at each *configure*.

    ``opened(ros)`` makes it; ``follow(steps)`` goes through its steps while it is active, in a
    thread of its own, and ends when they do. ``failed(error)`` is told there of an error that ended
    them: a node that is active and says nothing must not stay.
    """

    def __init__(
        self,
        opened: Callable[[RosNode], AbstractContextManager[LiveNode]],
        follow: Callable[[Iterator[StepResult]], None],
        failed: Callable[[Exception], None],
    ) -> None:
        self._opened = opened
        self._follow = follow
        self._failed = failed
        self._open = ExitStack()
        self._guard: LiveNode | None = None
        self._thread: threading.Thread | None = None

    def configure(self, ros: RosNode) -> None:
        """Read everything, listen to the source, serve the operator."""
        self._guard = self._open.enter_context(self._opened(ros))

    def activate(self) -> None:
        """Take steps. After an earlier *deactivate* the hold is latched until `~/rearm`."""
        if self._guard is not None:
            self._guard.live.resume()
            self._thread = threading.Thread(
                target=self._run, args=(self._guard,), name="guard", daemon=True
            )
            self._thread.start()

    def deactivate(self) -> None:
        """Take none any more, with hold as the last word."""
        if self._guard is not None and self._thread is not None:
            self._guard.live.stop()
            self._thread.join()
            self._thread = None

    def clean_up(self) -> None:
        """Leave the source, and close what `configure` made."""
        self._guard = None
        self._open.close()

    def _run(self, guard: LiveNode) -> None:
        try:
            with closing(guard.steps()) as steps:
                self._follow(steps)
        except Exception as error:  # handed over to the thread that can end the process
            self._failed(error)
