"""Process that publishes edges on ``/tf`` with Eclipse Cyclone DDS, one per line of input.

Prints ``ready`` when it has two readers. For each line of standard input it publishes the next
edge (``tracker -> sent_N``, stamp N ns) once, reliably. It does not import ROS.
"""

import sys
import time

from cyclone_peers import RELIABLE, participant, writer
from cyclone_types import Header, Quaternion, TFMessage, Time, Transform, TransformStamped, Vector3
from cyclonedds.core import Policy, Qos


def main():
    sent = writer(participant(), "rt/tf", TFMessage, Qos(RELIABLE, Policy.History.KeepAll))
    while len(sent.get_matched_subscriptions()) < 2:
        time.sleep(0.01)
    print("ready", flush=True)
    identity = Transform(Vector3(0.0, 0.0, 0.0), Quaternion(0.0, 0.0, 0.0, 1.0))
    for number, _ in enumerate(sys.stdin):
        header = Header(Time(0, number), "tracker")
        sent.write(TFMessage([TransformStamped(header, f"sent_{number}", identity)]))


if __name__ == "__main__":
    main()
