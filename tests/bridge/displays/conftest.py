"""Displays of a live node with a tracker."""

import os
import subprocess
import threading
from pathlib import Path
from types import SimpleNamespace

import pytest

from app.bridge import RosNode
from app.bridge.displays import SessionClient
from app.bridge.displays.remote_operator import PAGE_NODE
from app.fixture import MarginState, Reason
from app.geometry import MarginGuardError
from tests.bridge.conftest import TRACKED
from tests.forking import COMMAND, warm_parent
from tests.waiting import DEADLINE_S

NODE = "/marginguard"


class Display:
    """A display: its node, its client, and a thread that takes the steps."""

    def __init__(self, name: str, domain_id: int) -> None:
        self.ros = RosNode(name, domain_id=domain_id)
        self.client = SessionClient(self.ros, NODE)
        self.error = ""
        self._changed = threading.Condition()
        self._step = None
        self._thread = threading.Thread(target=self._take, daemon=True)
        self._thread.start()

    def until(self, condition):
        """The next step, with the operator, for which ``condition(step, operator)`` holds."""
        with self._changed:
            found = self._changed.wait_for(
                lambda: self.error or (self._step and condition(self._step, self.client.operator)),
                DEADLINE_S,
            )
            assert found, "no such step"
            assert not self.error, self.error
            return self._step, self.client.operator

    def close(self) -> None:
        self.client.close()
        self._thread.join()
        self.ros.close()

    def _take(self) -> None:
        try:
            for step in self.client.steps():
                with self._changed:
                    self._step = step
                    self._changed.notify_all()
        except MarginGuardError as error:
            self.error = str(error)
            with self._changed:
                self._changed.notify_all()


@pytest.fixture
def display(domain_id):
    """``display(NAME)`` is a display; closed after the test."""
    displays = []

    def begin(name=f"{PAGE_NODE}_1"):
        displays.append(Display(name, domain_id))
        return displays[-1]

    yield begin
    for each in displays:
        each.close()


@pytest.fixture
def forked_nodes(monkeypatch):
    """A live node that a display starts is forked: a new interpreter takes seconds."""

    def fork(command, *, stderr, **_):
        with Path(os.devnull).open("w") as null:
            outputs = {"stdout": null.fileno(), "stderr": stderr.fileno()}
            return warm_parent(COMMAND).start(command[1:], **outputs)

    forking = SimpleNamespace(**{**vars(subprocess), "Popen": fork})
    monkeypatch.setattr("app.bridge.displays.live_child.subprocess", forking)


def is_tracked(step, operator):
    return step.decision.state is not MarginState.UNKNOWN


def is_latched(step, operator):
    return is_tracked(step, operator) and Reason.LATCHED in step.decision.reasons


@pytest.fixture(scope="session")
def with_needle(live_yaml):
    """Configuration with a needle, whose length the operator can change."""
    config = live_yaml(TRACKED)
    with config.open("a") as file:
        file.write("needle: {frame: needle, length_mm: 60}\n")
    return config
