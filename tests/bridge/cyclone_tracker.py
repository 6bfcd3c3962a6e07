"""A tracker by another DDS implementation, Eclipse Cyclone DDS: edges of ``/tf``, one when asked.

Prints ``ready`` when two readers listen. For each line of standard input it sends the next edge
(``tracker -> sent_N``, stamped N ns), reliably and once. It imports nothing of ROS.
"""

import os
import sys
import time

from cyclone_types import Header, Quaternion, TFMessage, Time, Transform, TransformStamped, Vector3
from cyclonedds.core import Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.pub import DataWriter
from cyclonedds.topic import Topic
from cyclonedds.util import duration


def main():
    participant = DomainParticipant(int(os.environ["ROS_DOMAIN_ID"]))
    qos = Qos(Policy.Reliability.Reliable(duration(seconds=1)), Policy.History.KeepAll)
    writer = DataWriter(participant, Topic(participant, "rt/tf", TFMessage, qos=qos), qos=qos)
    while len(writer.get_matched_subscriptions()) < 2:
        time.sleep(0.01)
    print("ready", flush=True)
    nowhere = Transform(Vector3(0.0, 0.0, 0.0), Quaternion(0.0, 0.0, 0.0, 1.0))
    for number, _ in enumerate(sys.stdin):
        header = Header(Time(0, number), "tracker")
        writer.write(TFMessage([TransformStamped(header, f"sent_{number}", nowhere)]))


if __name__ == "__main__":
    main()
