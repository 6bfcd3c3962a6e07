"""A live session that other nodes control by ROS lifecycle: ``marginguard live --lifecycle``."""

import threading
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, closing

from app.bridge.live.live_node import LiveNode
from app.bridge.node import RosNode
from app.session import StepResult


class LiveNodeLifecycle:
    """A `LiveNode` for `app.bridge.control.LifecycleRosNode`; each *configure* makes a new one.

    ``opened(ros)`` makes it. ``follow(steps)`` iterates over its steps while it is active, in a
    thread of its own. ``failed(error)`` is called there with an error that ended the steps: an
    active node that publishes nothing must not remain.
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
        self._node: LiveNode | None = None
        self._thread: threading.Thread | None = None

    def configure(self, ros: RosNode) -> None:
        """Read all files, subscribe to the source, serve the operator."""
        self._node = self._open.enter_context(self._opened(ros))

    def activate(self) -> None:
        """Take steps. After an earlier *deactivate* the hold is latched until `~/rearm`."""
        if self._node is not None:
            self._node.live_run.live.resume()
            self._thread = threading.Thread(
                target=self._run, args=(self._node,), name="live steps", daemon=True
            )
            self._thread.start()

    def deactivate(self) -> None:
        """Stop stepping; the last constraint is on hold."""
        if self._node is not None and self._thread is not None:
            self._node.stop()
            self._thread.join()
            self._thread = None

    def clean_up(self) -> None:
        """Unsubscribe from the source and close everything that `configure` created."""
        self._node = None
        self._open.close()

    def _run(self, node: LiveNode) -> None:
        try:
            with closing(node.live_run.steps()) as steps:
                self._follow(steps)
        except Exception as error:  # the owner of the process decides
            self._failed(error)
