"""Processes of `benchmarks.rate`: ``python -m benchmarks.rate.processes PART FOLDER SECONDS CASE``.

Each prints ``ready``, waits for a line, prints ``done`` and writes its times to FOLDER. The parts
are ``sender`` (a session in real time, which sends at 1 kHz), ``receiver`` (rclpy alone, bytes read
by the CDR layout, independent of the sender's code) and ``bare`` (only sleeps, in the scheduling
class of the sending thread).
"""

import array
import sys
import threading
import time
from itertools import cycle
from pathlib import Path
from types import SimpleNamespace

import numpy as np
from numpy.typing import NDArray

from benchmarks.harness.peer import emit, paced, seq_of

RATE_HZ = 1000
Times = NDArray[np.int64]


def bare(folder: Path, seconds: float, case: Path) -> None:
    from app.bridge.heartbeat import ask_for_real_time

    woke_ns: Times = np.zeros(round(seconds * RATE_HZ), dtype=np.int64)

    def record(beat: int) -> None:
        woke_ns[beat] = time.monotonic_ns()

    ask_for_real_time()
    emit("ready")
    sys.stdin.readline()
    paced(len(woke_ns), 1e9 / RATE_HZ, record)
    np.save(folder / "bare.npy", woke_ns)
    emit("done")


def receiver(folder: Path, seconds: float, case: Path) -> None:
    """Record arrival and seq of each constraint until the second line of input."""
    import rclpy
    from marginguard_msgs.msg import FixtureConstraint
    from rclpy.event_handler import SubscriptionEventCallbacks

    records = array.array("q")

    def take(raw: bytes) -> None:
        now_ns = time.monotonic_ns()
        records.extend((seq_of(raw), now_ns))

    rclpy.init()
    node = rclpy.create_node("rate_receiver")
    ready = SubscriptionEventCallbacks(matched=lambda _: emit("ready"))
    topic, depth = "/rate_sender/constraint", 1000
    node.create_subscription(FixtureConstraint, topic, take, depth, raw=True, event_callbacks=ready)
    executor = rclpy.executors.SingleThreadedExecutor()
    executor.add_node(node)
    ended = rclpy.task.Future()

    def wait_for_end() -> None:
        sys.stdin.readline()
        sys.stdin.readline()
        time.sleep(0.2)  # messages in transit
        executor.create_task(lambda: ended.set_result(True))

    threading.Thread(target=wait_for_end, daemon=True).start()
    executor.spin_until_future_complete(ended)
    np.save(folder / "received.npy", np.array(records, dtype=np.int64).reshape(-1, 2))
    emit("done")
    rclpy.shutdown()


def sender(folder: Path, seconds: float, case: Path) -> None:
    from app.bridge import RosNode, topics
    from app.bridge.constraint_message import ConstraintBuilder
    from app.bridge.publishing.constraint_stream import ConstraintStream
    from app.runtime import prepare_case
    from app.session import Session

    prepared = prepare_case(case)
    setup = prepared.setup
    frames = list(prepared.case.frames())
    steps = 0
    builder = ConstraintBuilder(prepared.content)
    session = Session(setup, free_motion=True, skip_far=True)
    for frame in frames[:50]:
        builder.message(session.step(frame).decision)  # kernels are compiled before the run
    period_ns = (frames[-1].stamp.ns - frames[0].stamp.ns) // (len(frames) - 1)
    with RosNode("rate_sender") as ros:
        publisher = ros.publisher(topics.CONSTRAINT)
        if not ros.wait_for_subscribers(topics.CONSTRAINT, 1, 60.0):
            raise RuntimeError("no receiver was found")
        sent_ns = array.array("q")

        def publish(raw: bytes) -> None:
            sent_ns.append(time.monotonic_ns())
            publisher.publish(raw)

        emit("ready")
        sys.stdin.readline()
        cpu_s = time.process_time()
        stream = ConstraintStream(SimpleNamespace(publish=publish), RATE_HZ)
        begin_ns = time.monotonic_ns()
        for frame in cycle(frames):
            due_ns = begin_ns + steps * period_ns
            if due_ns - begin_ns > seconds * 1e9:
                break
            time.sleep(max(0, due_ns - time.monotonic_ns()) / 1e9)
            if frame is frames[0]:
                session = Session(setup, free_motion=True, skip_far=True)
            decision = session.step(frame).decision
            stream.publish(builder.message(decision), valid_ns=setup.margins.stale_after_ns)
            steps += 1
        stream.close()
        cpu_s = time.process_time() - cpu_s
    np.save(folder / "sent.npy", np.array(sent_ns))
    emit("done", missed=stream.missed, steps=steps, cpu_s=cpu_s)


if __name__ == "__main__":
    part, folder, seconds, case = sys.argv[1:]
    {"sender": sender, "receiver": receiver, "bare": bare}[part](
        Path(folder), float(seconds), Path(case)
    )
