"""ROS fixtures: a separate domain on this machine, peer processes, steps to publish."""

import json
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from app.case.frames.samples import JointSample, TrackingFrame
from app.fixture import (
    AppliedMargin,
    Constraint,
    FixtureDecision,
    MarginState,
    Proximity,
    Reason,
    Witnesses,
)
from app.geometry import Stamp, TrackedTransform, TrackingStatus, Transform
from app.runtime import SessionContent
from app.session import StepResult
from tests.ros_domain import domain_id as domain_id
from tests.session_content import ONE_LINK_URDF, one_link_content

HERE = Path(__file__).resolve().parent
RECEIVER = HERE / "receiver.py"
DEADLINE_S = 90.0
"""Timeout of a wait; none takes more than a few seconds if it succeeds."""


class Receiver:
    """Process that prints each message it receives as a line of JSON."""

    def __init__(
        self, script: Path, arguments: list[str], environment: dict[str, str], log: Path
    ) -> None:
        self._log = log
        with log.open("w") as errors:
            self._process = subprocess.Popen(
                [sys.executable, str(script), *arguments],
                stdout=subprocess.PIPE,
                stderr=errors,
                text=True,
                env={**os.environ, **environment},
            )
        # Ends a read that would otherwise block indefinitely.
        self._deadline = threading.Timer(DEADLINE_S, self._process.kill)
        self._deadline.start()
        self._early: list[str] = []

    def wait_until_ready(self) -> None:
        """Wait until the process has discovered a publisher for each of its topics."""
        early = []
        for line in self._lines():
            if line.strip() == "ready":
                self._early = early
                return
            early.append(line)  # latched message, received before the other publishers were found
        pytest.fail(f"the receiving process found no publisher: {self._result()}")

    def take(self, count: int) -> list[dict[str, Any]]:
        """Wait for the next ``count`` messages."""
        self._restart_deadline()
        lines = list(islice(self._lines(), count))
        if len(lines) < count:
            pytest.fail(f"received {len(lines)} messages; expected {count}: {self._result()}")
        return [json.loads(line) for line in lines]

    def messages(self) -> list[dict[str, Any]]:
        """All further messages until the process has received its counts and exits."""
        self._restart_deadline()
        lines = [line for line in self._lines() if line.strip() != "ready"]
        if self._process.wait() != 0:
            pytest.fail(f"the receiving process did not get all messages: {self._result()}")
        return [json.loads(line) for line in lines]

    @contextmanager
    def held(self) -> Iterator[None]:
        """Suspend the process in the ``with`` block."""
        self._process.send_signal(signal.SIGSTOP)
        try:
            yield
        finally:
            self._process.send_signal(signal.SIGCONT)

    def go_on(self) -> None:
        """Let a process go on that waits for SIGUSR1."""
        self._process.send_signal(signal.SIGUSR1)

    def close(self) -> None:
        self._deadline.cancel()
        if self._process.poll() is None:
            self._process.kill()
        self._process.wait()
        assert self._process.stdout is not None
        self._process.stdout.close()

    def _restart_deadline(self) -> None:
        self._deadline.cancel()
        self._deadline = threading.Timer(DEADLINE_S, self._process.kill)
        self._deadline.start()

    def _lines(self) -> Iterator[str]:
        assert self._process.stdout is not None
        while self._early:
            yield self._early.pop(0)
        yield from iter(self._process.stdout.readline, "")

    def _result(self) -> str:
        self._process.kill()
        return f"status {self._process.wait()}, {self._log.read_text()!r}"


StartReceiver = Callable[..., Receiver]


@pytest.fixture
def start_receiver(domain_id: int, tmp_path: Path) -> Iterator[StartReceiver]:
    """``start_receiver("/tf:tf2_msgs/msg/TFMessage:10", ...)``; killed after the test."""
    started: list[Receiver] = []

    def start(
        *arguments: str,
        script: Path = RECEIVER,
        environment: dict[str, str] | None = None,
        wait: bool = True,
    ) -> Receiver:
        receiver = Receiver(
            script, list(arguments), environment or {}, tmp_path / f"receiver_{len(started)}.log"
        )
        started.append(receiver)
        if wait:
            receiver.wait_until_ready()
        return receiver

    yield start
    for receiver in started:
        receiver.close()


CYCLONE = HERE / "cyclone_listener.py"
CYCLONE_ON_THIS_MACHINE = {
    "CYCLONEDDS_URI": (
        "<CycloneDDS><Domain><General>"
        "<Interfaces><NetworkInterface name='lo' multicast='false'/></Interfaces>"
        "<AllowMulticast>false</AllowMulticast>"
        "</General><Discovery><ParticipantIndex>auto</ParticipantIndex>"
        "<MaxAutoParticipantIndex>32</MaxAutoParticipantIndex>"
        "<Peers><Peer address='localhost'/></Peers>"
        "</Discovery></Domain></CycloneDDS>"
    )
}


@pytest.fixture
def start_cyclone(start_receiver: StartReceiver) -> StartReceiver:
    """``start_cyclone("virtual_fixture", "10")`` starts a ``/tf`` listener without ROS."""

    def start(*arguments: str, wait: bool = True) -> Receiver:
        return start_receiver(
            *arguments, script=CYCLONE, environment=CYCLONE_ON_THIS_MACHINE, wait=wait
        )

    return start


START_NS = 1_700_000_000_000_000_001
FRAME_NS = 20_000_000


@pytest.fixture
def content(tmp_path: Path) -> SessionContent:
    """Content with a tetrahedron as tumour, a smaller one as tool, and a registered robot."""
    urdf = tmp_path / "one_link.urdf"
    urdf.write_text(ONE_LINK_URDF)
    return one_link_content(urdf)


MakeStep = Callable[..., StepResult]


@pytest.fixture
def make_step() -> MakeStep:
    """``make_step(3)`` makes the fourth step of a replay at 50 Hz, with all frames tracked."""
    return _step


def _step(index: int, *, lost: bool = False, state: MarginState | None = None) -> StepResult:
    """Step with the tool 7.5 mm from the tumour, moving along x by 1 mm per step.

    The needle's sample is 3 ms older than the frame and governs the decision's stamp.
    """
    now = Stamp(START_NS + index * FRAME_NS)
    oldest = Stamp(now.ns - 3_000_000)
    cautery = Transform("tracker", "cautery", np.eye(3), [100.0 + index, -20.0, 30.0])
    poses = (
        TrackedTransform.lost("tracker", "cautery", now, TrackingStatus.INVALID)
        if lost
        else TrackedTransform(cautery, now, TrackingStatus.OK),
        TrackedTransform(
            Transform("reference", "needle", np.eye(3), [0.0, 50.0, 0.0]),
            oldest,
            TrackingStatus.OK,
        ),
    )
    joints = JointSample(("waist", "slide"), np.array([0.5, 0.01]), Stamp(now.ns - 5_000_000))
    state = state or (MarginState.UNKNOWN if lost else MarginState.NEGATIVE)
    constraint = Constraint(
        frame="tumor",
        normals=np.array([[0.0, 0.0, 1.0]]),
        offsets_mm=np.array([12.5]),
        points_on_tool_mm=np.array([[1.0, 2.0, 17.5]]),
        tumor_velocities_mm_s=np.array([[0.0, 4.0, 0.0]]),
        hold=lost,
    )
    decision = FixtureDecision(
        state=state,
        reasons=(Reason.INVALID, Reason.LATCHED) if lost else (Reason.CLEAR,),
        proximity=None
        if lost
        else Proximity(
            lower_bound_mm=7.25,
            witnesses=Witnesses.single(
                7.5,
                on_tool_mm=np.array([1.0, 2.0, 17.5]),
                on_tumor_mm=np.array([1.0, 2.0, 10.0]),
                normal=np.array([0.0, 0.0, 1.0]),
            ),
            stamp=oldest,
        ),
        margin=None if lost else AppliedMargin(1.0, 5.0, tre_mm=0.5, age_mm=0.25),
        constraint=constraint,
        hold=lost,
        stamp=oldest,
        seq=index,
        constraint_is_current=not lost,
    )
    return StepResult(
        index=index,
        frame=TrackingFrame(now, poses, (joints,)),
        decision=decision,
        tumor_from_tip=None if lost else Transform.identity("tumor", "cautery_tip"),
        virtual_fixture=constraint.fixture_frame(None),
        links={
            "base_link": Transform.identity("base_link", "base_link"),
            "stylus": Transform("base_link", "stylus", np.eye(3), [0.0, 0.0, 133.35]),
        },
        joints=joints,
    )
