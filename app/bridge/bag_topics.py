"""Topics of ROS as rosbag2 describes them: definition, hash of the type, quality of service."""

import json
import os
import sys
from pathlib import Path
from typing import Any

from rclpy.qos import (
    DurabilityPolicy,
    HistoryPolicy,
    LivelinessPolicy,
    QoSProfile,
    ReliabilityPolicy,
)

from app.bridge.qos import Topic
from app.case import BagTopic, message_definition
from app.geometry import NS_PER_S

_INFINITE_NS = 2**63 - 1


def bag_topic(name: str, topic: Topic) -> BagTopic:
    """``topic`` with its full ``name``; raises `InputError` if its type is not installed."""
    package, kind = topic.type.__module__.partition(".")[0], topic.type.__name__
    return BagTopic(
        name,
        f"{package}/msg/{kind}",
        message_definition(f"{package}/msg/{kind}", ros_prefixes()),
        (offered(topic.qos),),
        _type_hash(package, kind),
    )


def ros_prefixes() -> tuple[Path, ...]:
    """Prefixes of ROS installations and of this Python, where ROS packages are installed."""
    prefixes = os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)
    return (*(Path(prefix) for prefix in prefixes if prefix), Path(sys.prefix))


def offered(profile: QoSProfile) -> dict[str, Any]:
    """QoS profile of a publisher in the format of rosbag2."""
    return {
        "history": HistoryPolicy(profile.history).name.lower(),
        "depth": profile.depth,
        "reliability": ReliabilityPolicy(profile.reliability).name.lower(),
        "durability": DurabilityPolicy(profile.durability).name.lower(),
        "deadline": _duration(profile.deadline.nanoseconds),
        "lifespan": _duration(profile.lifespan.nanoseconds),
        "liveliness": LivelinessPolicy(profile.liveliness).name.lower(),
        "liveliness_lease_duration": _duration(profile.liveliness_lease_duration.nanoseconds),
        "avoid_ros_namespace_conventions": bool(profile.avoid_ros_namespace_conventions),
    }


def _type_hash(package: str, kind: str) -> str:
    """Hash of an installed message type, ``RIHS01_...``; empty if it is not known."""
    for prefix in ros_prefixes():
        try:
            text = (prefix / "share" / package / "msg" / f"{kind}.json").read_text("utf-8")
            for each in json.loads(text)["type_hashes"]:
                if each["type_name"] == f"{package}/msg/{kind}":
                    return str(each["hash_string"])
        except (OSError, ValueError, KeyError, TypeError):
            continue
    return ""


def _duration(ns: int) -> dict[str, int]:
    seconds, nanoseconds = divmod(min(ns, _INFINITE_NS), NS_PER_S)
    return {"sec": seconds, "nsec": nanoseconds}
