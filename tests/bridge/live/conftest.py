"""A live session in a process of its own, and a tracker in another that sends recorded frames."""

import json
import math
import os
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from itertools import islice
from pathlib import Path
from typing import Any

import pytest
import yaml

from app.case import TrackingFrame, open_case
from app.geometry import NS_PER_MS, NS_PER_S, TrackedTransform
from tests.bridge.conftest import StartReceiver as StartReceiver
from tests.bridge.conftest import start_receiver as start_receiver
from tests.ros_domain import domain_id as domain_id

DEADLINE_S = 90.0


class Child:
    """A process whose lines are read as they come; killed when a test waits too long for one."""

    def __init__(self, arguments: list[str], log: Path) -> None:
        self.log = log
        with log.open("w") as errors:
            self.process = subprocess.Popen(
                [sys.executable, *arguments],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=errors,
                text=True,
                env=dict(os.environ),
            )
        self._deadline = threading.Timer(DEADLINE_S, self.process.kill)
        self._deadline.start()

    def _wait_anew(self) -> None:
        """The time for one wait, however many there were before."""
        self._deadline.cancel()
        self._deadline = threading.Timer(DEADLINE_S, self.process.kill)
        self._deadline.start()

    def line(self, wanted: Callable[[str], bool] = lambda line: True) -> str:
        """The next line that is wanted; those before it are passed over."""
        assert self.process.stdout is not None
        self._wait_anew()
        passed = []
        for line in iter(self.process.stdout.readline, ""):
            if wanted(line):
                return line.strip()
            passed.append(line)
        status = self.process.wait()
        pytest.fail(f"status {status}, {''.join(passed)!r}, {self.log.read_text()!r}")

    def say(self, line: str) -> None:
        """Hand the process a line."""
        assert self.process.stdin is not None
        self.process.stdin.write(line + "\n")
        self.process.stdin.flush()

    def end(self, number: int) -> int:
        """Send a signal and wait; the exit status."""
        self._wait_anew()
        self.process.send_signal(number)
        return self.process.wait()

    def close(self) -> None:
        self._deadline.cancel()
        if self.process.poll() is None:
            self.process.kill()
        self.process.wait()
        for stream in (self.process.stdin, self.process.stdout):
            assert stream is not None
            stream.close()


Start = Callable[..., Child]


@pytest.fixture
def start(domain_id: int, tmp_path: Path) -> Iterator[Start]:
    """``start("-m", "app.cli", ...)``; killed at the end of the test."""
    started: list[Child] = []

    def start_child(*arguments: str) -> Child:
        child = Child(list(arguments), tmp_path / f"child_{len(started)}.log")
        started.append(child)
        return child

    yield start_child
    for child in started:
        child.close()


@pytest.fixture(scope="session")
def breach(project_root: Path) -> list[TrackingFrame]:
    """1.6 s of the recorded case around its first breach, all of it tracked."""
    frames = open_case(project_root / "data" / "recorded_case").recorded_frames()
    first = next(frames).stamp.ns
    wanted = [f for f in islice(frames, 2340) if f.stamp.ns - first >= 45.2 * NS_PER_S]
    assert all(sample.transform is not None for f in wanted for sample in f.poses)
    return wanted


@pytest.fixture
def frames_file(breach: list[TrackingFrame], tmp_path: Path) -> Path:
    """The frames for ``sender.py``; joints on the robot's own clock."""
    path = tmp_path / "frames.json"
    path.write_text(json.dumps([_plain(frame) for frame in breach]))
    return path


@pytest.fixture
def live_yaml(project_root: Path, tmp_path: Path) -> Callable[..., Path]:
    """``live_yaml(source)``: the example's configuration with another source and patience."""

    def write(source: dict[str, Any], stale_after_ms: float = 400.0) -> Path:
        values = yaml.safe_load((project_root / "data/live_example/live.yaml").read_text())
        values["source"] = source
        values["margins"]["stale_after_ms"] = stale_after_ms
        path = tmp_path / "live.yaml"
        path.write_text(yaml.safe_dump(values))
        return path

    return write


def _plain(frame: TrackingFrame) -> dict[str, Any]:
    return {
        "ns": frame.stamp.ns,
        "edges": [_edge(sample) for sample in frame.poses],
        "joints": [
            {
                "names": list(sample.names),
                "positions": list(sample.positions),
                "ns": sample.stamp.ns - round(37.4 * NS_PER_MS),
            }
            for sample in frame.joints
        ],
    }


def _edge(sample: TrackedTransform) -> dict[str, Any]:
    pose = sample.transform
    return {
        "parent": sample.target,
        "child": sample.source,
        "status": int(sample.status),
        "translation_m": [math.nan] * 3
        if pose is None
        else (pose.translation_mm / 1000.0).tolist(),
        "quaternion": [math.nan] * 4 if pose is None else pose.quaternion_xyzw.tolist(),
    }
