"""Process of `benchmarks.rate` that runs a session in real time and sends at 1 kHz."""

import json
import sys
import time
from itertools import cycle
from pathlib import Path

import numpy as np

from app.bridge import RosNode, topics
from app.bridge.publishing.constraint import ConstraintBuilder
from app.bridge.publishing.constraint_stream import ConstraintStream, RawPublisher
from app.runtime import prepare_case
from app.session import Session
from benchmarks.rate import RATE_HZ, Times


class RecordingPublisher:
    """Records the time at which each message is sent, in the order of the messages."""

    def __init__(self, publisher: RawPublisher, max_messages: int) -> None:
        self._publisher = publisher
        self._times_ns = np.zeros(max_messages, dtype=np.int64)
        self.count = 0

    def publish(self, raw: bytes) -> None:
        """Record the time, then send."""
        self._times_ns[self.count] = time.monotonic_ns()
        self.count += 1
        self._publisher.publish(raw)

    @property
    def times_ns(self) -> Times:
        """Sending times (count,) in ns."""
        return self._times_ns[: self.count]


def main() -> int:
    folder, seconds, case = Path(sys.argv[1]), float(sys.argv[2]), Path(sys.argv[3])
    prepared = prepare_case(case)
    setup = prepared.setup
    frames = list(prepared.case.frames())
    steps = 0
    builder = ConstraintBuilder(prepared.content)
    session = Session(setup)
    for frame in frames[:50]:
        builder.message(session.step(frame).decision)  # kernels are compiled before the run
    period_ns = (frames[-1].stamp.ns - frames[0].stamp.ns) // (len(frames) - 1)
    with RosNode("rate_sender") as ros:
        publisher = ros.publisher(topics.CONSTRAINT)
        if not ros.wait_for_subscribers(topics.CONSTRAINT, 1, 30.0):
            raise RuntimeError("no receiver was found")
        recording = RecordingPublisher(publisher, round(2.0 * (seconds + 1.0) * RATE_HZ))
        print("ready", flush=True)
        sys.stdin.readline()
        cpu_s = time.process_time()
        stream = ConstraintStream(recording, RATE_HZ)
        session = Session(setup)
        begin_ns = time.monotonic_ns()
        for frame in cycle(frames):
            due_ns = begin_ns + steps * period_ns
            if due_ns - begin_ns > seconds * 1e9:
                break
            time.sleep(max(0, due_ns - time.monotonic_ns()) / 1e9)
            if frame is frames[0]:
                session = Session(setup)
            decision = session.step(frame).decision
            stream.publish(builder.message(decision), valid_ns=setup.margins.stale_after_ns)
            steps += 1
        stream.close()
        cpu_s = time.process_time() - cpu_s
    np.save(folder / "sent.npy", recording.times_ns)
    report = {"missed": stream.missed, "steps": steps, "cpu_s": cpu_s}
    (folder / "sender.json").write_text(json.dumps(report))
    print("done", flush=True)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
