"""Process that publishes with Eclipse Cyclone DDS, with hand-written types.

    cyclone_publisher.py COUNT

Publishes a ``geometry_msgs/PoseArray`` of COUNT poses on ``/poses`` repeatedly; the position of
pose n is (n, 0, 0.5) m. Prints ``ready``; ends when it is killed. It does not import ROS.
"""

import sys
import time

from cyclone_peers import participant, writer
from cyclone_types import Header, Point, Pose, PoseArray, Quaternion, Time


def main(count):
    sent = writer(participant(), "rt/poses", PoseArray)
    print("ready", flush=True)
    upright = Quaternion(0.0, 0.0, 0.0, 1.0)
    poses = [Pose(Point(float(n), 0.0, 0.5), upright) for n in range(count)]
    while True:
        sent.write(PoseArray(Header(Time(1, 2), "tracker"), poses))
        time.sleep(0.01)


if __name__ == "__main__":
    main(int(sys.argv[1]))
