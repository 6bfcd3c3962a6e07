"""Process that publishes with Eclipse Cyclone DDS, with hand-written types.

    cyclone_publisher.py COUNT

Publishes a ``geometry_msgs/PoseArray`` of COUNT poses on ``/poses`` repeatedly; the position of
pose n is (n, 0, 0.5) m. Prints ``ready``; ends when it is killed. It does not import ROS.
"""

import os
import sys
import time

from cyclone_types import Header, Point, Pose, PoseArray, Quaternion, Time
from cyclonedds.core import Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.pub import DataWriter
from cyclonedds.topic import Topic
from cyclonedds.util import duration


def main(count):
    participant = DomainParticipant(int(os.environ["ROS_DOMAIN_ID"]))
    qos = Qos(Policy.Reliability.Reliable(duration(seconds=1)), Policy.History.KeepLast(10))
    writer = DataWriter(participant, Topic(participant, "rt/poses", PoseArray, qos=qos), qos=qos)
    print("ready", flush=True)
    upright = Quaternion(0.0, 0.0, 0.0, 1.0)
    poses = [Pose(Point(float(n), 0.0, 0.5), upright) for n in range(count)]
    while True:
        writer.write(PoseArray(Header(Time(1, 2), "tracker"), poses))
        time.sleep(0.01)


if __name__ == "__main__":
    main(int(sys.argv[1]))
