"""Process that receives ``/tf`` with Eclipse Cyclone DDS, with hand-written types.

    cyclone_listener.py CHILD COUNT

Prints ``ready`` when a publisher is discovered, then every transform on ``/tf`` as a line of JSON.
Exits with status 0 after COUNT transforms of the frame CHILD, with 1 after a minute without
messages. It imports neither the project nor ROS: names and layouts follow ROS 2's mapping to DDS
(topic prefix ``rt``, types ``package::msg::dds_::Type_``).
"""

import json
import os
import sys

from cyclone_types import TFMessage, TransformStamped
from cyclonedds.core import DDSStatus, Policy, Qos, WaitSet
from cyclonedds.domain import DomainParticipant
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration


def as_line(transform: TransformStamped) -> str:
    t, q = transform.transform.translation, transform.transform.rotation
    stamp = transform.header.stamp
    return json.dumps(
        {
            "parent": transform.header.frame_id,
            "child": transform.child_frame_id,
            "stamp_ns": stamp.sec * 1_000_000_000 + stamp.nanosec,
            "translation": [t.x, t.y, t.z],
            "rotation": [q.x, q.y, q.z, q.w],
        }
    )


def main(child: str, count: int) -> int:
    participant = DomainParticipant(int(os.environ["ROS_DOMAIN_ID"]))
    qos = Qos(
        Policy.Reliability.Reliable(duration(seconds=1)),
        Policy.Durability.Volatile,
        Policy.History.KeepLast(1000),
    )
    reader = DataReader(participant, Topic(participant, "rt/tf", TFMessage, qos=qos), qos=qos)
    reader.set_status_mask(DDSStatus.SubscriptionMatched)
    waiting = WaitSet(participant)
    waiting.attach(reader)
    # A volatile reader drops samples sent before it has discovered the writer, even if the writer
    # has already discovered the reader.
    if waiting.wait(timeout=duration(seconds=60)) == 0:
        print("no publisher of rt/tf found", file=sys.stderr)
        return 1
    waiting.detach(reader)
    print("ready", flush=True)
    for message in reader.take_iter(timeout=duration(seconds=60)):
        for transform in message.transforms:
            print(as_line(transform), flush=True)
            count -= transform.child_frame_id == child
        if count <= 0:
            return 0
    print(f"{count} transforms of {child!r} are still missing", file=sys.stderr)
    return 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1], int(sys.argv[2])))
