"""A live session in one process and a tracker that sends recorded frames in another."""

import json
import math
import os
import re
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from itertools import dropwhile, takewhile
from pathlib import Path
from typing import Any

import pytest
import yaml

from app.case import TrackingFrame, open_case
from app.geometry import NS_PER_MS, NS_PER_S, TrackedTransform
from tests import shipped_case
from tests.bridge.conftest import StartReceiver as StartReceiver
from tests.bridge.conftest import start_receiver as start_receiver
from tests.ros_domain import domain_id as domain_id

DEADLINE_S = 90.0


LOCAL_TIME = re.compile(r"^\d{4}-\d\d-\d\dT[\d:.]+[+-]\d\d:\d\d ")


class Child:
    """Process that is controlled by lines; killed if it prints none within `DEADLINE_S`."""

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

    def extend_deadline(self) -> None:
        """Start the deadline anew, in a test that follows another process meanwhile."""
        self._deadline.cancel()
        self._deadline = threading.Timer(DEADLINE_S, self.process.kill)
        self._deadline.start()

    def line(self, accept: Callable[[str], bool] = lambda line: True) -> str:
        """Wait for the next line that ``accept`` accepts; skip the lines before it.

        The local time that begins a line of a live session is removed.
        """
        assert self.process.stdout is not None
        self.extend_deadline()
        skipped = []
        for printed in iter(self.process.stdout.readline, ""):
            line = LOCAL_TIME.sub("", printed)
            if accept(line):
                return line.strip()
            skipped.append(line)
        status = self.process.wait()
        pytest.fail(f"status {status}, {''.join(skipped)!r}, {self.log.read_text()!r}")

    def send(self, line: str) -> None:
        """Write a line to the standard input of the process."""
        assert self.process.stdin is not None
        self.process.stdin.write(line + "\n")
        self.process.stdin.flush()

    def end(self, number: int) -> int:
        """Send the signal ``number``, wait for the exit and return the exit status."""
        self.extend_deadline()
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
    """``start("-m", "app.cli", ...)``; killed after the test."""
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
    """1.6 s of the shipped case around its first breach; every pose is tracked."""
    frames = open_case(project_root / "data" / "recorded_case").recorded_frames()
    first_ns = next(frames).stamp.ns
    start_ns = first_ns + round((shipped_case.DEEP["start_s"] - 0.5) * NS_PER_S)
    end_ns = start_ns + round(1.6 * NS_PER_S)
    from_start = dropwhile(lambda frame: frame.stamp.ns < start_ns, frames)
    found = list(takewhile(lambda frame: frame.stamp.ns < end_ns, from_start))
    assert all(sample.transform is not None for f in found for sample in f.poses)
    return found


@pytest.fixture
def frames_file(breach: list[TrackingFrame], tmp_path: Path) -> Path:
    """The frames as a file for ``sender.py``; joint states have the stamps of another clock."""
    path = tmp_path / "frames.json"
    path.write_text(json.dumps([_plain(frame) for frame in breach]))
    return path


@pytest.fixture
def live_yaml(project_root: Path, tmp_path: Path) -> Callable[..., Path]:
    """``live_yaml(source)`` writes the example's configuration with another source."""

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
                "ns": sample.stamp.ns - round(shipped_case.CLOCK_OFFSET_MS * NS_PER_MS),
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
