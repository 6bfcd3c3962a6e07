"""Process that receives ``/tf`` with Eclipse Cyclone DDS, with hand-written types.

    cyclone_listener.py CHILD COUNT

Prints ``ready`` when a publisher is discovered, then every transform on ``/tf`` as a line of JSON.
Ends after COUNT transforms of the frame CHILD. It imports neither the project nor ROS.
"""

import json
import sys

from cyclone_peers import next_sample, participant, reader, wait_for_publisher
from cyclone_types import TFMessage, TransformStamped


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


def main(child: str, count: int) -> None:
    owner = participant()
    transforms = reader(owner, "rt/tf", TFMessage)
    wait_for_publisher(owner, transforms)
    print("ready", flush=True)
    while count > 0:
        for transform in next_sample(transforms).transforms:
            print(as_line(transform), flush=True)
            count -= transform.child_frame_id == child


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]))
