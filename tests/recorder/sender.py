"""Process that sends the topics of a session.

    python -m tests.recorder.sender FILE

Prints ``sending`` when the recorder has subscribed to all topics. After a line on standard input it
ends, and writes the stamps (ns since 1970) of its messages by topic to FILE (``.npz``). Every stamp
is unique: it is the time of sending, in the message's header.
"""

import struct
import sys
import threading
import time

import numpy as np

from app.bridge import RosNode, prepare_environment
from app.geometry import NS_PER_S
from tests.recorder.streams import TICK_HZ, streams

_MATCH_TIMEOUT_S = 60.0
_STAMP = struct.Struct("<iI")


def main() -> int:
    prepare_environment()
    stop = threading.Event()
    sending = streams()
    sent: dict[str, list[int]] = {stream.topic.name: [] for stream in sending}
    with RosNode("recorder_sender") as ros:
        publishers = [ros.publisher(stream.topic) for stream in sending]
        for stream in sending:
            if not ros.wait_for_subscribers(stream.topic, 1, _MATCH_TIMEOUT_S):
                raise RuntimeError(f"the recorder has not subscribed to {stream.topic.name}")
        print("sending", flush=True)

        def read_input() -> None:
            sys.stdin.readline()
            stop.set()

        threading.Thread(target=read_input, daemon=True).start()
        began_ns, tick = time.monotonic_ns(), 0
        while not stop.is_set():
            for stream, publisher in zip(sending, publishers, strict=True):
                if tick % stream.ticks == 0:
                    for message in stream.messages:
                        ns = time.time_ns()
                        data = bytearray(message)
                        _STAMP.pack_into(data, stream.stamp_at, *divmod(ns, NS_PER_S))
                        publisher.publish(bytes(data))
                        sent[stream.topic.name].append(ns)
            tick += 1
            due_ns = began_ns + tick * (NS_PER_S // TICK_HZ)
            if (pause_ns := due_ns - time.monotonic_ns()) > 0:
                time.sleep(pause_ns / NS_PER_S)
    np.savez(sys.argv[1], **{name.replace("/", "|"): np.array(ns) for name, ns in sent.items()})
    return 0


if __name__ == "__main__":
    sys.exit(main())
