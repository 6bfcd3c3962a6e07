"""The live run of the panel: opened and joined to the ROS graph in the thread that steps."""

import logging
import threading
from collections.abc import Iterator
from pathlib import Path

from app.bridge import BridgeError, prepare_environment
from app.bridge.live import LiveNode, live_node
from app.runtime import OperatorCommands, prepare_live
from app.session import StepResult

CONSTRAINT_HZ = 1000.0


class LiveOpening:
    """`app.runtime.StepRun` of the ``live.yaml`` at ``config``."""

    def __init__(self, config: Path) -> None:
        self._config = config
        self._node: LiveNode | None = None
        self._lock = threading.Lock()
        self._stopped = False

    @property
    def commands(self) -> OperatorCommands | None:
        """Changes the session; None until it exists."""
        return None if self._node is None else self._node.commands

    def steps(self) -> Iterator[StepResult]:
        """Open the file, join the ROS graph, and yield the steps as they happen."""
        logging.info(prepare_environment())
        prepared = prepare_live(self._config)
        with live_node(prepared, namespace="", constraint_hz=CONSTRAINT_HZ) as node:
            with self._lock:
                self._node = node
                if self._stopped:
                    node.stop()
            yield from node.steps()

    def stop(self) -> None:
        """Leave the graph; while it is still being joined, as soon as that is done."""
        with self._lock:
            self._stopped = True
            if self._node is not None:
                self._node.stop()

    def set_margins(self, stop_mm: float, warn_mm: float) -> None:
        """Set the node's parameters, so that ROS sees them too; `BridgeError` before it exists."""
        if self._node is None:
            raise BridgeError(f"{self._config.name}: the session has not started yet")
        self._node.set_margins(stop_mm, warn_mm)

    def pace(self) -> float:
        """The time of live stamps passes as every clock's does."""
        return 1.0
