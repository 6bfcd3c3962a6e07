"""A process of another DDS implementation: Eclipse Cyclone DDS, its types written here by hand.

    cyclone_listener.py CHILD COUNT

Prints ``ready`` once a publisher was found, then every transform that arrives on ``/tf`` as a line
of JSON, and ends with status 0 once COUNT transforms of the frame CHILD have come (status 1 after
a minute without). It imports nothing of the project and nothing of ROS: names and layouts are
those of ROS 2's mapping to DDS (topic prefix ``rt``, types ``package::msg::dds_::Type_``).
"""

import json
import os
import sys
from dataclasses import dataclass

from cyclonedds.core import DDSStatus, Policy, Qos, WaitSet
from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import float64, int32, sequence, uint32
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration


@dataclass
class Time(IdlStruct, typename="builtin_interfaces::msg::dds_::Time_"):
    sec: int32
    nanosec: uint32


@dataclass
class Header(IdlStruct, typename="std_msgs::msg::dds_::Header_"):
    stamp: Time
    frame_id: str


@dataclass
class Vector3(IdlStruct, typename="geometry_msgs::msg::dds_::Vector3_"):
    x: float64
    y: float64
    z: float64


@dataclass
class Quaternion(IdlStruct, typename="geometry_msgs::msg::dds_::Quaternion_"):
    x: float64
    y: float64
    z: float64
    w: float64


@dataclass
class Transform(IdlStruct, typename="geometry_msgs::msg::dds_::Transform_"):
    translation: Vector3
    rotation: Quaternion


@dataclass
class TransformStamped(IdlStruct, typename="geometry_msgs::msg::dds_::TransformStamped_"):
    header: Header
    child_frame_id: str
    transform: Transform


@dataclass
class TFMessage(IdlStruct, typename="tf2_msgs::msg::dds_::TFMessage_"):
    transforms: sequence[TransformStamped]


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
    # A volatile reader drops what is sent before it knows the writer, even from a writer that
    # knows the reader already.
    if waiting.wait(timeout=duration(seconds=60)) == 0:
        print("nobody publishes rt/tf", file=sys.stderr)
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
