"""Live run of the panel: opens the file and starts the ROS node in the thread that steps."""

import logging
import threading
from collections.abc import Iterator
from pathlib import Path

from app.bridge import BridgeError, prepare_environment
from app.bridge.live import LiveNode, live_node
from app.runtime import OperatorCommands, WorkflowOutput, prepare_live
from app.session import LiveImages, StepResult

CONSTRAINT_HZ = 1000.0


class LiveStepRun:
    """`app.runtime.StepRun` of the ``live.yaml`` at ``config``."""

    def __init__(self, config: Path) -> None:
        self._config = config
        self.workflow: WorkflowOutput | None = None
        """Guided recordings and breaches; None until the file is open."""
        self.images: LiveImages | None = None
        """Images of the session; None until the file is open, and for one without images."""
        self._node: LiveNode | None = None
        self._lock = threading.Lock()
        self._stopped = False

    @property
    def commands(self) -> OperatorCommands | None:
        """Commands of the session; None until it exists."""
        return None if self._node is None else self._node.commands

    def steps(self) -> Iterator[StepResult]:
        """Open the file, start the ROS node, and yield the steps as they happen."""
        logging.info(prepare_environment())
        prepared = prepare_live(self._config)
        self.workflow = workflow = WorkflowOutput(prepared.content)
        self.images = prepared.live_images()
        with live_node(
            prepared,
            namespace="",
            constraint_hz=CONSTRAINT_HZ,
            outputs=(workflow,),
            images=self.images,
        ) as node:
            with self._lock:
                self._node = node
                if self._stopped:
                    node.stop()
            yield from node.steps()

    def stop(self) -> None:
        """End `steps`; while the node is being started, as soon as it has started."""
        with self._lock:
            self._stopped = True
            if self._node is not None:
                self._node.stop()

    def set_margins(self, stop_mm: float, warn_mm: float) -> None:
        """Set the parameters of the node; raises `BridgeError` before it exists."""
        if self._node is None:
            raise BridgeError(
                f"{self._config.name}: the session has not started yet; expected a started one"
            )
        self._node.set_margins(stop_mm, warn_mm)

    def pace(self) -> float:
        """Live stamps advance in real time."""
        return 1.0
