"""A live session in this process: what ``marginguard live`` does, shown in Slicer."""

import logging
import threading
from collections.abc import Iterator
from contextlib import AbstractContextManager
from pathlib import Path

from app.bridge import BridgeError, prepare_environment
from app.bridge.control import SessionChanges
from app.bridge.live import LiveNode, guarding
from app.case import open_live
from app.session import Session, StepResult, setup_from_case, with_repaired_tumor

CONSTRAINT_HZ = 1000.0


class LiveSteps:
    """Guards with the ``live.yaml`` at ``config``; opened in the thread that steps."""

    def __init__(self, config: Path) -> None:
        self._config = config
        self._guard: LiveNode | None = None
        self._lock = threading.Lock()
        self._halted = False

    @property
    def changes(self) -> SessionChanges | None:
        """Changes the session, and what is published of it; None until it is there."""
        return None if self._guard is None else self._guard.changes

    def steps(self) -> Iterator[StepResult]:
        """Join the ROS graph, and yield the steps as they happen."""
        logging.info(prepare_environment())
        config = open_live(self._config)
        case = with_repaired_tumor(config.case)
        setup = setup_from_case(case)
        with guarding(
            config, case, setup, namespace="", constraint_hz=CONSTRAINT_HZ, tip_only=False
        ) as guard:
            with self._lock:
                self._guard = guard
                if self._halted:
                    guard.live.stop()
            yield from guard.steps()

    def halt(self) -> None:
        """Leave the graph; while it is still being joined, as soon as that is done."""
        with self._lock:
            self._halted = True
            if self._guard is not None:
                self._guard.live.stop()

    def between_steps(self) -> AbstractContextManager[Session]:
        """The session, while no step is taken; `BridgeError` before it is there."""
        return self._begun().live.between_steps()

    def set_margins(self, stop_mm: float, warn_mm: float) -> None:
        """As the node's parameters ``stop_mm`` and ``warn_mm``, so that ROS knows of them too."""
        self._begun().margins.set(stop_mm=stop_mm, warn_mm=warn_mm)

    def pace(self) -> float:
        """That of every clock."""
        return 1.0

    def _begun(self) -> LiveNode:
        if self._guard is None:
            raise BridgeError(f"{self._config.name}: the session has not begun yet")
        return self._guard
